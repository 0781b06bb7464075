"""What ``trailmark bench run`` does, step by step."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import click

from trailmark.cli.errors import say
from trailmark.cli.root import ChosenPlugins
from trailmark.config.document import Document, Problems
from trailmark.config.explain import validate_at
from trailmark.errors import ConfigError
from trailmark.isolation.executor import Executor
from trailmark.isolation.fingerprint import FileCache
from trailmark.pipeline.outputs.provenance import provenance
from trailmark.plugins import Plugins
from trailmark_bench.cell import Cell
from trailmark_bench.cli.commands import RunOptions
from trailmark_bench.cli.progress import BenchProgress, duration_text
from trailmark_bench.cli.showing import show_states, show_tables
from trailmark_bench.durations import estimated_s
from trailmark_bench.index import INDEX_FILE, Index
from trailmark_bench.matrix import Bench, load_bench
from trailmark_bench.order import first_samples
from trailmark_bench.page import write_page
from trailmark_bench.passes import going_on_from, known_from, noting_pass
from trailmark_bench.rehearsal import misfits
from trailmark_bench.scheduler import cells_to_run, run_bench

__all__ = ["list_bench", "run_bench_command"]


def list_bench(request: RunOptions, plugins: Plugins, chosen: ChosenPlugins) -> None:
    """List the cells of a bench, and what keeps some from starting; nothing is run, and nothing is written.

    Raises
    ------
    ConfigError
        If a localizer does not find its sensor, or a source does not start.
    DataError
        If the file of results is none.
    """
    own = Index(request.folder) if has_begun(request.folder) else None
    bench = load(request, plugins, chosen, {} if own is None else own.file_digests())
    say_changed(bench, own)
    with ExitStack() as around:
        known = own
        if request.results is not None and request.results.exists():
            known = around.enter_context(known_from(request.results, own))
        unfit = misfits(bench.cells, plugins, {} if known is None else known.states())
        list_cells(bench, known, unfit, request.as_json)
    named = {cell.id: cell.label for cell in first_samples(bench.cells) if not cell.is_installed}
    if problems := dict.fromkeys(f"{label}: {unfit[cell_id]}" for cell_id, label in named.items() if cell_id in unfit):
        raise ConfigError("these cells cannot start:\n" + "\n".join(problems))


def run_bench_command(request: RunOptions, plugins: Plugins, chosen: ChosenPlugins) -> None:
    """Run the missing cells of a bench, and print what all cells show."""
    with _saying_what_is_kept(), ExitStack() as opened:
        known = opened.enter_context(Index(request.folder, write=True)) if has_begun(request.folder) else None
        cache = {} if known is None else known.file_digests()
        bench = load(request, plugins, chosen, cache)
        whole = whole_bench(request, plugins, chosen, cache)
        index = known or opened.enter_context(Index(request.folder, write=True))  # a refused config leaves no folder
        index.keep_file_digests(cache)
        say_changed(bench, index)
        remember(index, bench, request.config)
        executor = executor_of(bench, plugins, request)
        budget_s = math.inf if request.hours is None else 3600.0 * request.hours
        with ExitStack() as around:
            if request.results is not None:
                say(around.enter_context(going_on_from(index, bench.cells, request.results, whole)))
            around.enter_context(noting_pass(index))
            progress = around.enter_context(BenchProgress())
            lost = run_bench(bench.cells, index, executor, retry=request.retry, on_progress=progress, budget_s=budget_s)
        conclude(index, request.no_report, request.as_json)
        states = index.states()
    left = [] if lost else cells_to_run(bench.cells, states)
    if left:
        say(left_words(left, bench.cells, states))
    if lost:
        say(f"{len(lost)} cells are pending: what ran them was lost, more than once; the same command goes on")
        raise click.exceptions.Exit(1)


def has_begun(folder: Path) -> bool:
    """Return whether a bench has begun in a folder."""
    return (folder / INDEX_FILE).is_file()


def left_words(left: Sequence[Cell], cells: Sequence[Cell], states: Mapping[str, str]) -> str:
    """Return what the time was not enough for, in a line."""
    begun = {_without_samples(cell) for cell in cells if states.get(cell.id, "pending") not in ("pending", "running")}
    n_unseen = len({_without_samples(cell) for cell in left} - begun)
    more = f"of {n_unseen} combinations not one" if n_unseen else "of every combination one at least has"
    return f"the time is over: {len(left)} of {len(cells)} cells have not been run, {more}; the same command goes on"


def _without_samples(cell: Cell) -> tuple[object, ...]:
    return cell.matrix, *(value for axis, value in cell.coordinates.items() if axis not in ("seed", "place"))


@contextmanager
def _saying_what_is_kept() -> Iterator[None]:
    """Print what is kept when a signal ends the bench; its cells are killed then."""
    try:
        yield
    except KeyboardInterrupt:
        say("interrupted: what is finished is kept; the same command goes on")
        raise


def load(request: RunOptions, plugins: Plugins, chosen: ChosenPlugins, cache: FileCache) -> Bench:
    """Read the config; say what the reader should know."""
    bench = _read(request, plugins, chosen, cache)
    for notice in bench.notices:
        say(notice)
    if not bench.cells:
        raise ConfigError(f"{request.config}: nothing is left of the matrix")
    return bench


def whole_bench(request: RunOptions, plugins: Plugins, chosen: ChosenPlugins, cache: FileCache) -> Sequence[Cell]:
    """Return also the cells that ``--only`` and ``--quick`` leave out, where a file of results may know them."""
    if request.results is None or not (request.only or request.quick):
        return ()
    return _read(replace(request, only=(), quick=False), plugins, chosen, cache).cells


def _read(request: RunOptions, plugins: Plugins, chosen: ChosenPlugins, cache: FileCache) -> Bench:
    bench = load_bench(
        request.config,
        plugins=plugins,
        overrides=request.changes,
        only=request.only,
        files=chosen.files,
        block=chosen.block,
        cache=cache,
    )
    return replace(bench, cells=tuple(first_samples(bench.cells))) if request.quick else bench


def remember(index: Index, bench: Bench, config: Path) -> None:
    """Keep with the cells what tables and report need of the config."""
    section = bench.section
    index.set_meta(
        name=bench.name,
        version=section.version,
        metrics=list(section.metrics),
        baseline=section.baseline,
        judging=section.judging.model_dump(mode="json"),
        provenance=provenance(config.parent),
    )


def executor_of(bench: Bench, plugins: Plugins, request: RunOptions) -> Executor:
    """Return the executor of the config, or the one that the command names."""
    written = dict(bench.section.executor)
    plugin = str(written.pop("plugin", "local"))
    if request.executor not in (None, plugin):
        plugin, written = str(request.executor), {}
    jobs = 1 if request.alone else request.jobs
    written |= {} if request.scheduler is None else {"scheduler": request.scheduler}
    written |= {} if jobs is None else {"jobs": jobs}
    spec = plugins.registry.find("executor", plugin)
    document = Document({"executor": written}, name=f"executor {plugin!r}")
    problems = Problems(document)
    config = validate_at(spec.load_config(), written, (), problems, document.base_dir)
    problems.raise_if_any()
    executor: Executor = spec.load()(config)
    return executor


def conclude(index: Index, no_report: bool, as_json: bool) -> None:
    """Print the tables and write the report; exit code 1 when no cell gave a result."""
    if not as_json:
        show_tables(index, (), None, as_json=False)
    else:
        show_states(index, (), as_json=True)
    if not no_report:
        page = write_page(index)
        if not as_json:
            click.echo(f"{click.format_filename(index.folder)}\n{click.format_filename(page)}")
    states = {record.state for record in index.records()}
    if "ok" not in states and states & {"failed", "crashed", "timeout"}:
        raise click.exceptions.Exit(1)  # a method that fails is a result; a bench without any is not


def say_changed(bench: Bench, index: Index | None) -> None:
    """Print how many cells have run at another address: with other code, or another config of what they name."""
    done = [record for record in ([] if index is None else index.records(everything=True)) if record.attempts]
    ids, labels = {record.id for record in done}, {record.label for record in done}
    n_changed = sum(cell.id not in ids and cell.label in labels for cell in bench.cells)
    if n_changed:
        say(
            f"{n_changed} cells have run with other code or another config: they are others now, to be run."
            " 'code: version' under 'bench:' lets changes of code pass"
        )


def list_cells(bench: Bench, index: Index | None, unfit: Mapping[str, str], as_json: bool) -> None:
    """Print the cells with the time that they will take, as cells like them have run; `unfit` are skipped."""
    records = [] if index is None else index.records(everything=True)
    states = {} if index is None else index.states()
    times = estimated_s(bench.cells, records)
    rows = [
        {"id": cell.id, "matrix": cell.matrix, **cell.coordinates,
         "state": "skipped" if cell.missing or cell.id in unfit else states.get(cell.id, "pending"),
         "reason": cell.missing or unfit.get(cell.id, ""),
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
