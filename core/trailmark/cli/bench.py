"""``trailmark bench``: localizers, pipelines, sources, faults and seeds crossed; ``show``, ``merge``, ``export``."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from trailmark.cli.errors import say
from trailmark.cli.root import ChosenPlugins, plugins_of
from trailmark.errors import ConfigError

if TYPE_CHECKING:
    from trailmark.bench.index import Index
    from trailmark.bench.matrix import Bench
    from trailmark.plugins import Plugins

__all__ = ["bench_group"]

_FOLDER = click.Path(path_type=Path, file_okay=False)
_RETRY = ("failed", "crashed", "timeout", "skipped", "all")


class _BenchGroup(click.Group):
    """``trailmark bench CONFIG`` is ``trailmark bench run CONFIG``."""

    def parse_args(self, context: click.Context, arguments: list[str]) -> list[str]:
        known = {*self.commands, "-h", "--help"}
        if arguments and arguments[0] not in known:
            arguments = ["run", *arguments]
        return super().parse_args(context, arguments)


@click.group("bench", cls=_BenchGroup)
def bench_group() -> None:
    """Cross localizers, pipelines, sources, faults and seeds, and compare them.

    `trailmark bench CONFIG` runs what is missing and writes a report; run again, it goes on where it was.
    """


@bench_group.command("run")
@click.argument("config", type=click.Path(path_type=Path))
@click.option("--out", type=_FOLDER, help="Folder of the bench; default runs/bench/NAME: run again, it goes on.")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override a key: bench.cells.seeds=2.")
@click.option("--only", multiple=True, metavar="AXIS=NAME", help="Only these cells: localizer=klt,orb.")
@click.option("--list", "is_list", is_flag=True, help="List the cells with the time they will take; run nothing.")
@click.option("--retry", multiple=True, type=click.Choice(_RETRY), help="Run only the cells that ended so.")
@click.option("--jobs", type=click.IntRange(1), help="Cells at a time.")
@click.option("--alone", is_flag=True, help="One cell at a time, for times that count.")
@click.option("--timeout", type=click.FloatRange(0, min_open=True), metavar="SECONDS", help="For each cell.")
@click.option("--executor", metavar="NAME", help="Where cells run: local, dask, or a plugin's.")
@click.option("--scheduler", metavar="ADDRESS", help="Of a Dask cluster.")
@click.option("--no-report", is_flag=True, help="Leave the report out.")
@click.option("--json", "as_json", is_flag=True, help="Print the cells as JSON.")
@click.pass_context
def run_command(
    context: click.Context,
    /,
    config: Path,
    out: Path | None,
    overrides: tuple[str, ...],
    only: tuple[str, ...],
    is_list: bool,
    retry: tuple[str, ...],
    jobs: int | None,
    alone: bool,
    timeout: float | None,
    executor: str | None,
    scheduler: str | None,
    no_report: bool,
    as_json: bool,
) -> None:
    """Run the cells of CONFIG that have not been run, and write tables and a report."""
    from trailmark.bench.index import INDEX_FILE, Index

    folder = out or Path("runs/bench") / config.stem
    plugins = plugins_of(context)
    chosen: ChosenPlugins = context.find_root().obj or ChosenPlugins()
    if alone and jobs not in (None, 1):
        raise ConfigError(f"--alone runs one cell at a time; leave --jobs {jobs} out")
    changes = [*overrides, *([f"bench.limits.timeout_s={timeout}"] if timeout else [])]
    if is_list:
        known = Index(folder) if (folder / INDEX_FILE).is_file() else None
        cache = {} if known is None else known.file_digests()
        bench = _load(config, plugins, changes, only, chosen, cache)
        _list(bench, known, as_json)
        return
    with Index(folder, write=True) as index:
        cache = index.file_digests()
        bench = _load(config, plugins, changes, only, chosen, cache)
        index.keep_file_digests(cache)
        _remember(index, bench, config)
        where = _executor(bench, plugins, executor, scheduler, 1 if alone else jobs)
        _run(bench, index, where, retry)
        _conclude(index, folder, no_report, as_json)


@bench_group.command("show")
@click.argument("folder", metavar="DIR", type=_FOLDER)
@click.argument("cell", required=False)
@click.option("--metric", "metrics", multiple=True, metavar="NAME", help="Quantities to show; default: the bench's.")
@click.option("--baseline", metavar="NAME", help="Compare with this one.")
@click.option("--state", "states", multiple=True, metavar="STATE", help="List the cells in this state.")
@click.option("--html", "is_html", is_flag=True, help="Write the report anew.")
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
def show_command(
    folder: Path,
    cell: str | None,
    metrics: tuple[str, ...],
    baseline: str | None,
    states: tuple[str, ...],
    is_html: bool,
    as_json: bool,
) -> None:
    """Show the tables of a bench, or one CELL of it: by the first digits of its id, or by words of its name."""
    from trailmark.bench.index import Index

    with Index(folder) as index:
        if cell is not None:
            _show_cell(index, cell, as_json)
        elif states:
            _show_states(index, states, as_json)
        else:
            _show_tables(index, metrics, baseline, as_json)
        if is_html:
            from trailmark.bench.page import write_page

            click.echo(str(write_page(index, baseline=baseline)))


@bench_group.command("merge")
@click.argument("folders", metavar="DIR...", nargs=-1, required=True, type=_FOLDER)
@click.option("--out", required=True, type=_FOLDER, help="Folder of the merged bench; it may be one of DIR.")
def merge_command(folders: tuple[Path, ...], out: Path) -> None:
    """Put benches together: cells of one address are one cell, whichever machine ran it."""
    from trailmark.bench.merge import merge_benches

    for line in merge_benches(folders, out):
        click.echo(line)


@bench_group.command("export")
@click.argument("form", metavar="csv|latex|markdown", type=click.Choice(["csv", "latex", "markdown"]))
@click.argument("folder", metavar="DIR", type=_FOLDER)
@click.option("--metric", "metrics", multiple=True, metavar="NAME", help="Quantities; default: the bench's.")
@click.option("--baseline", metavar="NAME", help="Compare with this one.")
@click.option("--cells", "is_cells", is_flag=True, help="A row for each cell instead of the statistics (csv).")
@click.option("--to", type=click.Path(path_type=Path, dir_okay=False), help="A file; default: standard output.")
def export_command(
    form: str, folder: Path, metrics: tuple[str, ...], baseline: str | None, is_cells: bool, to: Path | None
) -> None:
    """Write the tables of a bench for a paper, a page or another program."""
    from trailmark.bench.export import exported
    from trailmark.bench.index import Index

    if is_cells and form != "csv":
        raise ConfigError(f"--cells is for csv: {form} has tables of statistics")
    with Index(folder) as index:
        text = exported(index, form, metrics, baseline, is_cells)
    if to is None:
        click.echo(text, nl=False)
    else:
        to.write_text(text, encoding="utf-8")


def _load(
    config: Path, plugins: Plugins, changes: Sequence[str], only: Sequence[str], chosen: ChosenPlugins, cache: Any
) -> Bench:
    from trailmark.bench.matrix import load_bench

    bench = load_bench(
        config, plugins=plugins, overrides=changes, only=only, files=chosen.files, block=chosen.block, cache=cache
    )
    for notice in bench.notices:
        say(notice)
    if not bench.cells:
        raise ConfigError(f"{config}: nothing is left of the matrix")
    return bench


def _remember(index: Index, bench: Bench, config: Path) -> None:
    from trailmark.pipeline.provenance import provenance

    section = bench.section
    index.set_meta(
        name=bench.name,
        metrics=list(section.metrics),
        baseline=section.baseline,
        judging=section.judging.model_dump(mode="json"),
        provenance=provenance(config.parent),
    )


def _executor(bench: Bench, plugins: Plugins, name: str | None, scheduler: str | None, jobs: int | None) -> Any:
    from trailmark.config.document import Document, Problems
    from trailmark.config.explain import validated

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
    return spec.load()(config)


def _run(bench: Bench, index: Index, executor: Any, retry: Sequence[str]) -> None:
    from trailmark.bench.scheduler import run_bench
    from trailmark.cli.bench_progress import BenchProgress

    with BenchProgress() as progress:
        try:
            run_bench(bench.cells, index, executor, retry=retry, on_progress=progress)
        except KeyboardInterrupt:
            say("interrupted: what is finished is kept; the same command goes on")
            raise


def _conclude(index: Index, folder: Path, no_report: bool, as_json: bool) -> None:
    if not as_json:
        _show_tables(index, (), None, as_json=False)
    else:
        _show_states(index, (), as_json=True)
    if not no_report:
        from trailmark.bench.page import write_page

        page = write_page(index)
        if not as_json:
            click.echo(f"{folder}\n{page}")
    states = {record.state for record in index.records()}
    if "ok" not in states and states & {"failed", "crashed", "timeout"}:
        raise click.exceptions.Exit(1)  # a method that fails is a result; a bench without any is not


def _list(bench: Bench, index: Index | None, as_json: bool) -> None:
    from trailmark.bench.scheduler import estimated_s
    from trailmark.cli.bench_progress import duration_text

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
    from trailmark.cli.bench_progress import duration_text

    if not n_left:
        return ""
    if len(known) < n_left:
        return f"; {n_left - len(known)} of them are like none that has run: their time is not known"
    return f", about {duration_text(sum(known))} one at a time"


def _show_tables(index: Index, metrics: Sequence[str], baseline: str | None, as_json: bool) -> None:
    from trailmark.bench.tables import bench_summary, bench_tables

    summary = bench_summary(index, metrics, baseline)
    if as_json:
        click.echo(json.dumps(summary.document(), indent=1))
        return
    from trailmark.report.console import print_table

    for table in bench_tables(summary):
        print_table(table)
    for line in summary.lines():
        click.echo(line)


def _show_states(index: Index, states: Sequence[str], as_json: bool) -> None:
    from trailmark.bench.cell import STATES

    for state in states:
        if state not in STATES:
            raise ConfigError(f"--state {state}: states are {', '.join(STATES)}")
    records = [record for record in index.records() if not states or record.state in states]
    if as_json:
        click.echo(json.dumps([_document(record) for record in records], indent=1))
        return
    for record in records:
        click.echo(
            f"{record.id[:8]}  {record.state:<8} {record.label}" + (f": {record.reason}" if record.reason else "")
        )


def _show_cell(index: Index, words: str, as_json: bool) -> None:
    records = index.records(everything=True)
    found = [record for record in records if record.id.startswith(words) or words in record.label]
    exact = [record for record in found if words in (record.id, record.label)]
    if len(exact or found) != 1:
        names = "; ".join(f"{record.id[:8]} {record.label}" for record in found[:5])
        raise ConfigError(f"{words!r} is no cell" if not found else f"{words!r} is {len(found)} cells: {names} ...")
    (record,) = exact or found
    if as_json:
        click.echo(json.dumps(_document(record) | {"stderr": index.stderr(record.id)}, indent=1))
        return
    click.echo(f"{record.id}  {record.label}\n{record.state}" + (f": {record.reason}" if record.reason else ""))
    for name, value in {**record.result.get("metrics", {}), **record.result.get("times", {})}.items():
        click.echo(f"  {name:<44}{'' if value is None else f'{value:.6g}':>14}")
    folder = index.folder / "cells" / record.id
    if folder.is_dir():
        click.echo(str(folder))
    if stderr := index.stderr(record.id).rstrip():
        click.echo("\n".join(f"| {line}" for line in stderr.splitlines()[-30:]))


def _document(record: Any) -> dict[str, Any]:
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
