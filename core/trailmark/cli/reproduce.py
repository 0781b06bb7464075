"""``trailmark reproduce``: a paper's experiments, its figures beside ours."""

from __future__ import annotations

import json
import re
import secrets
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import click

from trailmark.cli.errors import say
from trailmark.cli.root import plugins_of
from trailmark.errors import ConfigError
from trailmark.experiments import CALLS_FOLDER, ExperimentOptions, Row

__all__ = ["SeedType", "reproduce_command"]

#: The word for a seed that is to be drawn.
_DRAW = "random"
#: As many seeds there are to draw from.
_N_SEEDS = 1_000_000


class SeedType(click.IntRange):
    """A seed: a number, or `random` for one that is drawn and said, so that it can be given again."""

    name = "seed"

    def __init__(self) -> None:
        super().__init__(min=0)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number; one is drawn for the word `random`."""
        if value != _DRAW:
            return super().convert(value, param, ctx)
        drawn = secrets.randbelow(_N_SEEDS)
        say(f"seed {drawn} was drawn; --seed {drawn} repeats this")
        return drawn


@click.command("reproduce")
@click.argument("paper", required=False)
@click.option("--quick", is_flag=True, help="Short versions.")
@click.option(
    "--seed",
    default="0",
    show_default=True,
    type=SeedType(),
    help="First seed: noise, people, place; or `random`.",
)
@click.option("--place", type=click.IntRange(0), help="World seed of all drives.  [default: of the seed]")
@click.option("--places", type=click.IntRange(1), help="How many.  [default: 5; 1 with --quick]")
@click.option("--out", type=click.Path(path_type=Path), default=Path("runs/reproduce"), show_default=True)
@click.option("--jobs", default=1, show_default=True, type=click.IntRange(1), help="Runs at a time.")
@click.option("--json", "as_json", is_flag=True, help="Print the rows as JSON.")
@click.pass_context
def reproduce_command(context: click.Context, /, paper: str | None, out: Path, as_json: bool, **request: Any) -> None:
    """Repeat the experiments of PAPER (or `all`); without PAPER, list them.

    Rows, plots and a page of Markdown are written to a folder for each paper under --out. The same command again
    goes on with an experiment that was interrupted there.
    """
    specs = {spec.name: spec for spec in plugins_of(context).registry.specs("experiment")}
    if paper is None:
        _list(specs, as_json)
        return
    if paper != "all" and paper not in specs:
        known = ", ".join(sorted(specs)) or "none (no installed plugin brings one)"
        raise ConfigError(f"no experiments named '{paper}'; available: {known}, or 'all'")
    names = sorted(specs) if paper == "all" else [paper]
    rows: list[Row] = []
    for name in names:
        found = _repeat(specs[name], out / name, **request)
        rows.extend(found)
        if not as_json:
            _print_table(specs[name].summary, found)
            say(f"{out / name / 'results.md'}")
    if as_json:
        click.echo(json.dumps([row.document() for row in rows], indent=1))


def _repeat(spec: Any, folder: Path, *, jobs: int, **request: Any) -> Sequence[Row]:
    from trailmark.isolation.calls import forget_calls
    from trailmark.pipeline.outputs.provenance import provenance
    from trailmark.report.experiment import write_experiment

    say(f"{spec.name}: {spec.summary}")
    began_s, origin = time.monotonic(), provenance()
    # Whoever repeats this gives the seed that was drawn.
    origin["command"] = re.sub(rf"(--seed[ =]){_DRAW}\b", rf"\g<1>{request['seed']}", origin["command"])
    folder.mkdir(parents=True, exist_ok=True)
    _keep_only_the_same(folder, request)
    options = ExperimentOptions(out=folder, report=lambda line: say(f"  {line}"), jobs=jobs, is_kept=True, **request)
    rows: Sequence[Row] = spec.load()(options)
    forget_calls(folder / CALLS_FOLDER)
    where = {} if options.place is None else {"place": options.place}
    write_experiment(folder, spec.summary, spec.reference, rows, origin | where, time.monotonic() - began_s)
    return rows


def _keep_only_the_same(folder: Path, request: dict[str, Any]) -> None:
    """Forget the answers of another request: its files lie in the same places."""
    from trailmark.isolation.calls import forget_calls

    calls = folder / CALLS_FOLDER
    noted = calls / "request.json"
    if _noted_request(noted) != request:
        forget_calls(calls)
        calls.mkdir(parents=True)
        noted.write_text(json.dumps(request), encoding="utf-8")


def _noted_request(file: Path) -> Any:
    """Return what was asked for before; None: nothing, or a file that was cut off."""
    with suppress(OSError, ValueError):
        return json.loads(file.read_text(encoding="utf-8"))
    return None


def _list(specs: dict[str, Any], as_json: bool) -> None:
    if as_json:
        listed = [{"name": name, "summary": spec.summary, "reference": spec.reference} for name, spec in specs.items()]
        click.echo(json.dumps(listed, indent=1))
        return
    for name, spec in sorted(specs.items()):
        click.echo(f"{name:<16}{spec.summary}")
    if not specs:
        click.echo("no installed plugin brings experiments")


def _print_table(title: str, rows: Sequence[Row]) -> None:
    from rich.table import Table

    from trailmark.report.console import table_console

    table = Table(box=None, header_style="bold", pad_edge=False, title=title, title_justify="left", title_style="bold")
    table.add_column("experiment")
    table.add_column("item")
    for column in ("unit", "paper", "faithful", "ours", "+-", "bar", "n"):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("")
    marks = {True: "[green]met[/]", False: "[red]not met[/]", None: ""}
    for row in rows:
        numbers = [_number(value) for value in (row.paper, row.faithful, row.ours, row.spread, row.bar)]
        table.add_row(row.experiment, row.item, row.unit, *numbers, str(row.n), marks[row.met])
    table_console().print(table)


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"
