"""``trailmark compare``: runs, or the localizers of one run, side by side."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from trailmark.cli.root import plugins_of
from trailmark.cli.trajectories import align_option, short_names
from trailmark.evaluation import AlignKind, Protocol, evaluate_run, metrics_of
from trailmark.report.tables import (
    Table,
    Trajectories,
    consistency_table,
    offsets_table,
    sources_table,
    trajectories_table,
)

__all__ = ["compare_command"]

Runs = Sequence[tuple[str, dict[str, Any]]]


@click.command("compare")
@click.argument("folders", metavar="DIR...", nargs=-1, required=True, type=click.Path(path_type=Path))
@align_option
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
@click.pass_context
def compare_command(context: click.Context, /, folders: tuple[Path, ...], align: AlignKind, as_json: bool) -> None:
    """Compare runs, or the localizers of one run, against ground truth; without it by their differences."""
    protocol, metrics = Protocol(align=align), metrics_of(plugins_of(context).registry)
    documents = [evaluate_run(folder, protocol=protocol, metrics=metrics, write=False) for folder in folders]
    if as_json:
        shown = [{"folder": str(folder), **document} for folder, document in zip(folders, documents, strict=True)]
        click.echo(json.dumps(shown, indent=1))
        return
    runs = list(zip(short_names(folders), documents, strict=True))
    _print(runs)


def _print(runs: Runs) -> None:
    from trailmark.report.console import print_table

    titles = ("run", "trajectory") if len(runs) > 1 else ("trajectory",)
    for table in _trajectory_tables(runs, titles):
        print_table(table)
    sources = [
        ((run, name) if len(runs) > 1 else (name,), item)
        for run, document in runs
        for name, item in document["sources"].items()
    ]
    if sources:
        label_titles = (*titles[:-1], "localizer")
        tables = (
            offsets_table(sources, label_titles),
            sources_table(sources, label_titles),
            consistency_table(sources, label_titles),
        )
        for table in filter(None, tables):
            print_table(table)
    for run, document in runs:
        if document["map_frame"]:
            click.echo(f"{run}: {document['map_frame']}", err=True)
        for problem in document["problems"]:
            click.echo(f"{run}: {problem}", err=True)


def _trajectory_tables(runs: Runs, titles: Sequence[str]) -> list[Table]:
    """Return a table of errors, and one of differences for each run without ground truth: never both in one."""
    with_truth = [(run, document) for run, document in runs if document["errors"]]
    groups = [with_truth] if with_truth else []
    groups += [[(run, document)] for run, document in runs if not document["errors"]]
    return [trajectories_table(Trajectories.of_runs(_label_runs(group, titles)), titles) for group in groups]


def _label_runs(runs: Runs, titles: Sequence[str]) -> list[tuple[tuple[str, ...], dict[str, Any]]]:
    return [((run,) if len(titles) > 1 else (), document) for run, document in runs]
