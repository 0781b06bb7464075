"""What ``trailmark bench run`` does, step by step."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import click

from trailmark.bench.executor import Executor
from trailmark.bench.fingerprint import FileCache
from trailmark.bench.index import Index
from trailmark.bench.matrix import Bench, load_bench
from trailmark.bench.page import write_page
from trailmark.bench.scheduler import estimated_s, run_bench
from trailmark.cli.bench_progress import BenchProgress, duration_text
from trailmark.cli.bench_show import show_states, show_tables
from trailmark.cli.errors import say
from trailmark.cli.root import ChosenPlugins
from trailmark.config.document import Document, Problems
from trailmark.config.explain import validated
from trailmark.errors import ConfigError
from trailmark.pipeline.provenance import provenance
from trailmark.plugins import Plugins

__all__ = ["conclude", "executor_of", "list_cells", "load", "remember", "run_cells", "say_changed"]


def load(
    config: Path, plugins: Plugins, changes: Sequence[str], only: Sequence[str], chosen: ChosenPlugins, cache: FileCache
) -> Bench:
    """Read the config; say what the reader should know."""
    bench = load_bench(
        config, plugins=plugins, overrides=changes, only=only, files=chosen.files, block=chosen.block, cache=cache
    )
    for notice in bench.notices:
        say(notice)
    if not bench.cells:
        raise ConfigError(f"{config}: nothing is left of the matrix")
    return bench


def remember(index: Index, bench: Bench, config: Path) -> None:
    """Keep with the cells what tables and report need of the config."""
    section = bench.section
    index.set_meta(
        name=bench.name,
        metrics=list(section.metrics),
        baseline=section.baseline,
        judging=section.judging.model_dump(mode="json"),
        provenance=provenance(config.parent),
    )


def executor_of(bench: Bench, plugins: Plugins, name: str | None, scheduler: str | None, jobs: int | None) -> Executor:
    """Return the executor of the config, or the one that the command names."""
    written = dict(bench.section.executor)
    plugin = str(written.pop("plugin", "local"))
    if name is not None and name != plugin:
        plugin, written = name, {}
    written |= {} if scheduler is None else {"scheduler": scheduler}
    written |= {} if jobs is None else {"jobs": jobs}
    spec = plugins.registry.find("executor", plugin)
    document = Document({"executor": written}, name=f"executor {plugin!r}")
    problems = Problems(document)
    config = validated(spec.load_config(), written, (), problems, document.base_dir)
    problems.raise_if_any()
    executor: Executor = spec.load()(config)
    return executor


def run_cells(bench: Bench, index: Index, executor: Executor, retry: Sequence[str]) -> None:
    """Run what is to run, with its progress."""
    with BenchProgress() as progress:
        try:
            run_bench(bench.cells, index, executor, retry=retry, on_progress=progress)
        except KeyboardInterrupt:
            say("interrupted: what is finished is kept; the same command goes on")
            raise


def conclude(index: Index, folder: Path, no_report: bool, as_json: bool) -> None:
    """Print the tables and write the report; exit code 1 when no cell gave a result."""
    if not as_json:
        show_tables(index, (), None, as_json=False)
    else:
        show_states(index, (), as_json=True)
    if not no_report:
        page = write_page(index)
        if not as_json:
            click.echo(f"{folder}\n{page}")
    states = {record.state for record in index.records()}
    if "ok" not in states and states & {"failed", "crashed", "timeout"}:
        raise click.exceptions.Exit(1)  # a method that fails is a result; a bench without any is not


def say_changed(bench: Bench, index: Index | None) -> None:
    """Say how many cells have run at another address: with other code, or another config of what they name."""
    done = [record for record in ([] if index is None else index.records(everything=True)) if record.attempts]
    ids, labels = {record.id for record in done}, {record.label for record in done}
    n_changed = sum(cell.id not in ids and cell.label in labels for cell in bench.cells)
    if n_changed:
        say(
            f"{n_changed} cells have run with other code or another config: they are others now, to be run."
            " 'code: version' under 'bench:' lets changes of code pass"
        )


def list_cells(bench: Bench, index: Index | None, as_json: bool) -> None:
    """Print the cells with the time that they will take, as far as cells like them have run."""
    records = [] if index is None else index.records(everything=True)
    states = {} if index is None else index.states()
    times = estimated_s(bench.cells, records)
    rows = [
        {"id": cell.id, "matrix": cell.matrix, **cell.coordinates,
         "state": "skipped" if cell.missing else states.get(cell.id, "pending"), "reason": cell.missing,
         "estimated_s": None if time_s is None else round(time_s, 2)}
        for cell, time_s in zip(bench.cells, times, strict=True)
    ]  # fmt: skip
    if as_json:
        click.echo(json.dumps(rows, indent=1))
        return
    for cell, row in zip(bench.cells, rows, strict=True):
        took = "?" if row["estimated_s"] is None else duration_text(row["estimated_s"])
        note = f"  ({row['reason']})" if row["reason"] else ""
        click.echo(f"{cell.id[:8]}  {row['state']:<8} {took:>9}  {cell.label}{note}")
    left = [row for row in rows if row["state"] in ("pending", "running")]
    known = [row["estimated_s"] for row in left if row["estimated_s"] is not None]
    say(f"{len(rows)} cells, {len(left)} to run" + _estimate_words(len(left), known))


def _estimate_words(n_left: int, known: Sequence[float]) -> str:
    if not n_left:
        return ""
    told = f", about {duration_text(sum(known))} one at a time" if known else ""
    n_unknown = n_left - len(known)
    return told + (f"; {n_unknown} of them are like none that has run: their time is not known" if n_unknown else "")
