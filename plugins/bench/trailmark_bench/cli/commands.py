"""``trailmark bench``: localizers, pipelines, sources, faults and seeds crossed; ``show``, ``merge``, ``export``."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from trailmark.cli.root import ChosenPlugins, plugins_of
from trailmark.cli.watch import watch, watch_options
from trailmark.errors import ConfigError, DataError

__all__ = ["RunOptions", "bench_group"]

_FOLDER = click.Path(path_type=Path, file_okay=False)
_FILE = click.Path(path_type=Path, dir_okay=False)
_RETRY = ("failed", "crashed", "timeout", "skipped", "all")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """What ``trailmark bench run`` was asked for, one field for each option."""

    config: Path
    out: Path | None = None
    overrides: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    is_list: bool = False
    retry: tuple[str, ...] = ()
    jobs: int | None = None
    alone: bool = False
    timeout: float | None = None
    hours: float | None = None
    quick: bool = False
    executor: str | None = None
    scheduler: str | None = None
    results: Path | None = None
    no_report: bool = False
    as_json: bool = False

    @property
    def folder(self) -> Path:
        """The folder of the bench."""
        return self.out or Path("runs/bench") / self.config.stem

    @property
    def changes(self) -> tuple[str, ...]:
        """Overrides of the config, those among them that have an option of their own."""
        return (*self.overrides, *([f"bench.limits.timeout_s={self.timeout}"] if self.timeout else []))


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
@click.option("--hours", type=click.FloatRange(0, min_open=True), help="Begin no cell later; the next call goes on.")
@click.option("--quick", is_flag=True, help="Only one place and one seed of everything: the first that it has.")
@click.option("--executor", metavar="NAME", help="Where cells run: local, dask, or a plugin's.")
@click.option("--scheduler", metavar="ADDRESS", help="Of a Dask cluster.")
@click.option("--results", type=_FILE, help="Go on from this file of `export json`, and write it anew at the end.")
@click.option("--no-report", is_flag=True, help="Leave the report out.")
@click.option("--json", "as_json", is_flag=True, help="Print the cells as JSON.")
@click.pass_context
def run_command(context: click.Context, /, **options: Any) -> None:
    """Run the cells of CONFIG that have not been run, and write tables and a report.

    CONFIG is a file, or `grand`: everything that is here, on everything that is here.
    """
    from trailmark_bench.cli.running import list_bench, run_bench_command
    from trailmark_bench.suites import find_config

    request = RunOptions(**options | {"config": find_config(options["config"])})
    if request.alone and request.jobs not in (None, 1):
        raise ConfigError(f"--alone runs one cell at a time; leave --jobs {request.jobs} out")
    chosen: ChosenPlugins = context.find_root().obj or ChosenPlugins()
    carry_out = list_bench if request.is_list else run_bench_command
    carry_out(request, plugins_of(context), chosen)


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
    from trailmark_bench.cli.opening import open_filled
    from trailmark_bench.cli.showing import show_cell, show_states, show_tables

    if cell is not None and (states or metrics):
        raise ConfigError(f"{cell!r} is one cell, shown with all its figures: --state and --metric are for several")
    if baseline is not None and (cell is not None or states) and not is_html:
        raise ConfigError("--baseline is for the tables, and cells are compared with nothing; leave it out")
    with open_filled(folder) as index:
        if cell is not None:
            show_cell(index, cell, as_json)
        elif states:
            show_states(index, states, as_json, metrics)
        else:
            show_tables(index, metrics, baseline, as_json)
        if is_html:
            from trailmark_bench.page import write_page

            click.echo(click.format_filename(write_page(index, baseline=baseline)))


@bench_group.command("site")
@click.argument("folder", metavar="DIR", type=_FOLDER)
@click.option("--to", required=True, type=_FOLDER, help="Folder of the site; index.html is written into it.")
@click.option("--baseline", metavar="NAME", help="Compare with this one.")
@click.option("--most-mb", type=click.FloatRange(0.1), default=5.0, show_default=True, help="Size of the page.")
@click.option("--overwrite", is_flag=True, help="Write into a folder that is not empty.")
def site_command(folder: Path, to: Path, baseline: str | None, most_mb: float, overwrite: bool) -> None:
    """Write a bench as a page for the web: who wins where, rankings with intervals, faults, trajectories, cells.

    An earlier site of a bench is renewed; another folder that is not empty needs --overwrite.
    """
    from trailmark_bench.cli.opening import open_filled
    from trailmark_bench.cli.targets import refuse_strange_folder
    from trailmark_bench.page import write_site

    refuse_strange_folder(to, overwrite)
    with open_filled(folder) as index:
        click.echo(click.format_filename(write_site(index, to, baseline=baseline, most_mb=most_mb)))


@bench_group.command("watch")
@click.argument("folder", metavar="DIR", type=_FOLDER)
@watch_options
def watch_command(folder: Path, every: float, once: bool) -> None:
    """Watch a bench from its folder while it goes on."""
    from trailmark_bench.cli.watching import look_at_bench

    watch(look_at_bench(folder), every, once)


@bench_group.command("schema")
@click.pass_context
def schema_command(context: click.Context) -> None:
    """Print the JSON schema of bench configs with everything that is installed."""
    from trailmark_bench.schema import bench_config_schema

    click.echo(json.dumps(bench_config_schema(plugins_of(context)), indent=1, ensure_ascii=False))


@bench_group.command("merge")
@click.argument("folders", metavar="DIR|FILE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--out", required=True, type=_FOLDER, help="Folder of the merged bench; it may be one of DIR.")
def merge_command(folders: tuple[Path, ...], out: Path) -> None:
    """Put benches together: cells of one address are one cell, whichever machine ran it.

    A FILE is one of `trailmark bench export json`, from whoever sent it.
    """
    from trailmark_bench.cli.opening import open_filled
    from trailmark_bench.merge import merge_benches

    for folder in folders:
        if folder.is_dir():  # a file is checked as it is read
            with open_filled(folder):
                pass
    for line in merge_benches(folders, out):
        click.echo(line)
    with open_filled(out):  # a file of results may hold no cell either
        pass


@bench_group.command("export")
@click.argument("form", metavar="csv|latex|markdown|json", type=click.Choice(["csv", "latex", "markdown", "json"]))
@click.argument("folder", metavar="DIR", type=_FOLDER)
@click.option("--metric", "metrics", multiple=True, metavar="NAME", help="Quantities; default: the bench's.")
@click.option("--baseline", metavar="NAME", help="Compare with this one.")
@click.option("--cells", "is_cells", is_flag=True, help="A row for each cell instead of the statistics (csv).")
@click.option("--to", type=_FILE, help="A file; default: standard output.")
@click.option("--overwrite", is_flag=True, help="Replace the file that is there.")
def export_command(
    form: str,
    folder: Path,
    metrics: tuple[str, ...],
    baseline: str | None,
    is_cells: bool,
    to: Path | None,
    overwrite: bool,
) -> None:
    """Write the tables of a bench for a paper, a page or another program; as json, all cells, for `merge` elsewhere."""
    from trailmark_bench.cell import FINISHED
    from trailmark_bench.cli.opening import open_filled
    from trailmark_bench.cli.targets import is_stream, refuse_standing_file
    from trailmark_bench.export import export_text
    from trailmark_bench.shared import shared_results, write_results

    if is_cells and form != "csv":
        raise ConfigError(f"--cells is for csv: {form} has tables of statistics")
    if is_cells and (metrics or baseline):
        raise ConfigError("--cells gives every figure of every cell: --metric and --baseline are for statistics")
    if form == "json" and (metrics or baseline):
        raise ConfigError("json holds every cell with all its figures: --metric and --baseline are for tables")
    if overwrite and to is None:
        raise ConfigError("--overwrite belongs to --to: nothing is replaced on standard output")
    if to is not None:
        refuse_standing_file(to, overwrite)
    with open_filled(folder) as index:
        if form == "json" and not any(record.state in FINISHED for record in index.records()):
            raise DataError(f"{folder}: no cell has ended, so there is nothing to send; the bench can go on")
        if form == "json" and to is not None and not is_stream(to):
            write_results(index, to)
            return
        text = shared_results(index) if form == "json" else export_text(index, form, metrics, baseline, is_cells)
    if to is None:
        click.echo(text, nl=False)
    else:
        to.write_text(text, encoding="utf-8")
