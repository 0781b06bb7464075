"""What ``trailmark bench`` prints: tables, lists of cells, one cell."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import click

from trailmark.errors import ConfigError
from trailmark.report.console import print_table
from trailmark.report.numbers import MISSING
from trailmark_bench.cell import STATES
from trailmark_bench.index import CellRecord, Index
from trailmark_bench.quantities import metrics_of, refuse_unknown
from trailmark_bench.summary import summarize_bench
from trailmark_bench.tables import bench_tables

__all__ = ["show_cell", "show_states", "show_tables"]


def show_tables(index: Index, metrics: Sequence[str], baseline: str | None, as_json: bool) -> None:
    """Print the tables of a bench."""
    summary = summarize_bench(index, metrics, baseline)
    if as_json:
        click.echo(json.dumps(summary.document(), indent=1))
        return
    for table in bench_tables(summary):
        print_table(table)
    for line in summary.lines():
        click.echo(line)


def show_states(index: Index, states: Sequence[str], as_json: bool, metrics: Sequence[str] = ()) -> None:
    """Print a line for each cell in some states, or in any, with some of its figures; as JSON with all of them.

    Raises
    ------
    ConfigError
        If there is no such state, or no cell has such a quantity.
    """
    for state in states:
        if state not in STATES:
            raise ConfigError(f"--state {state}: states are {', '.join(STATES)}")
    everything = index.records()
    chosen = metrics_of(metrics, everything)
    refuse_unknown(metrics, chosen, everything)
    for metric in chosen:
        if all(metric.value_of(record) is None for record in everything):
            raise ConfigError(f"no cell has a metric {metric.name!r}: none has given a result")
    records = [record for record in everything if not states or record.state in states]
    if as_json:
        click.echo(json.dumps([_document(record) for record in records], indent=1))
        return
    for record in records:
        values = ((metric.name, metric.value_of(record)) for metric in chosen)
        figures = "".join(f"  {name} {MISSING if value is None else f'{value:.6g}'}" for name, value in values)
        why = f": {record.reason}" if record.reason else ""
        click.echo(f"{record.id[:8]}  {record.state:<8} {record.label}{why}{figures}")


def show_cell(index: Index, words: str, as_json: bool) -> None:
    """Print what became of a cell, with its figures and the end of its log.

    Raises
    ------
    ConfigError
        If the words fit none, or several.
    """
    record = _find_cell(index, words)
    if as_json:
        click.echo(json.dumps(_document(record) | {"stderr": index.stderr(record.id)}, indent=1))
        return
    click.echo(f"{record.id}  {record.label}\n{record.state}" + (f": {record.reason}" if record.reason else ""))
    for name, value in {**record.result.get("metrics", {}), **record.result.get("times", {})}.items():
        click.echo(f"  {name:<44}{'' if value is None else f'{value:.6g}':>14}")
    folder = index.folder / "cells" / record.id
    if folder.is_dir():
        click.echo(click.format_filename(folder))
    if stderr := index.stderr(record.id).rstrip():
        click.echo("\n".join(f"| {line}" for line in stderr.splitlines()[-30:]))


def _find_cell(index: Index, words: str) -> CellRecord:
    """Return the cell that the words fit; one of an earlier config or of earlier code only where no other does."""
    for everything in (False, True):
        records = index.records(everything)
        found = [record for record in records if record.id.startswith(words) or words in record.label]
        exact = [record for record in found if words in (record.id, record.label)]
        chosen = exact or found
        if len(chosen) == 1:
            return chosen[0]
        if chosen:
            names = "; ".join(f"{record.id[:8]} {record.label}" for record in chosen[:5])
            raise ConfigError(f"{words!r} is {len(chosen)} cells: {names}{' ...' if len(chosen) > 5 else ''}")
    raise ConfigError(f"{words!r} is no cell")


def _document(record: CellRecord) -> dict[str, Any]:
    return {
        "id": record.id,
        "matrix": record.matrix,
        "coordinates": dict(record.coordinates),
        "state": record.state,
        "reason": record.reason,
        "attempts": record.attempts,
        "wall_s": record.wall_s,
        "cpu_s": record.cpu_s,
        "peak_rss_mb": record.peak_rss_mb,
        "load": record.load,
        "host": record.host,
        **{key: value for key, value in record.result.items() if key not in ("state", "reason")},
    }
