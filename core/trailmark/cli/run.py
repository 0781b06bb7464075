"""``trailmark run``, ``teach`` and ``replay``: one pipeline, three modes."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from trailmark.cli.errors import say
from trailmark.cli.root import plugins_of
from trailmark.errors import ConfigError
from trailmark.interruption import TELL_S, ending_signal, shielded

if TYPE_CHECKING:
    from trailmark.interfaces import Access, Mode
    from trailmark.pipeline import Pipeline, RunRequest, RunResult, Step
    from trailmark.watching.notes import LiveNotes

    OnStep = Callable[[Pipeline, Step], None]

__all__ = ["replay_command", "run_command", "teach_command"]

_Function = TypeVar("_Function", bound=Callable[..., Any])
_STORE = click.Path(path_type=Path, dir_okay=False)


def _run_options(function: _Function) -> _Function:
    """Add the options that the three commands share."""
    options = (
        click.option("--out", type=click.Path(path_type=Path), help="Folder of the run; default runs/DATE-NAME."),
        click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override a key: a.b.c=value."),
        click.option("--overwrite", "overwrite", is_flag=True, help="Replace what an earlier run left in --out."),
        click.option("--seed", type=click.IntRange(0), help="Seed of all random numbers."),
        click.option("--pace", type=click.Choice(["step", "realtime"]), help="As fast as possible, or by the stamps."),
        click.option("--progress", type=click.Choice(["auto", "json", "none"]), default="auto", show_default=True),
        click.option("--no-report", is_flag=True, help="Leave plots and report out."),
        click.option("--watch", "is_watched", is_flag=True, help="Serve a page on this machine that shows it live."),
        click.option(
            "--port", type=click.IntRange(0, 65535), default=0, help="Of the page; default: one that is free."
        ),
        click.option("--notes", type=click.Path(path_type=Path), hidden=True),
        click.option("--strict", is_flag=True, help="Fail, with exit code 1, where the end would only be a warning."),
        click.option("--json", "as_json", is_flag=True, help="Print the rows at the end as JSON."),
    )
    for option in reversed(options):
        function = option(function)
    return function


@click.command("run")
@click.argument("target", metavar="CONFIG|RECORDING")
@_run_options
@click.option("--store", type=_STORE, help="Localize in this taught place, read-only.")
@click.option("--localizer", "localizers", multiple=True, help="Without a config: a localizer to run.")
@click.option("--calibration", help="Without a config: the calibration file of the recording's sensor.")
@click.pass_context
def run_command(
    context: click.Context,
    /,
    target: str,
    store: Path | None,
    localizers: tuple[str, ...],
    calibration: str | None,
    **options: Any,
) -> None:
    """Run a pipeline over a recording, a camera or a simulated world.

    CONFIG is a YAML or TOML file. A RECORDING (a film, a folder of pictures, a bag, `camera`) needs no config: the
    source is guessed, and the config is written to the run's folder.
    """
    config = _config_of(context, target, localizers, calibration)
    _execute(_request(context, config, options, store=store), target, options)


@click.command("teach")
@click.argument("config", metavar="CONFIG")
@_run_options
@click.option("--store", type=_STORE, required=True, help="The path store to write, a file F.trail.")
@click.option("--append", "append", is_flag=True, help="Go on with the path in the store.")
@click.option("--overwrite-store", is_flag=True, help="Replace the store, once the first waypoint is there.")
@click.pass_context
def teach_command(
    context: click.Context, /, config: str, store: Path, append: bool, overwrite_store: bool, **options: Any
) -> None:
    """Drive or play a path and remember it.

    An existing store needs --append, or --overwrite-store (or --overwrite, which replaces the run's folder too).
    """
    if append and (overwrite_store or options["overwrite"]):
        raise ConfigError("--append goes on with the store and --overwrite replaces it: choose one")
    access: Access = "append" if append else "overwrite" if overwrite_store or options["overwrite"] else "create"
    _execute(_request(context, config, options, store=store, mode="teach", access=access), config, options)


@click.command("replay")
@click.argument("config", metavar="CONFIG")
@_run_options
@click.option("--store", type=_STORE, required=True, help="The path store to follow.")
@click.option("--reverse", is_flag=True, help="From the end to the start.")
@click.option("--repeat", type=float, help="Round trips; 0.5 is one way.")
@click.pass_context
def replay_command(
    context: click.Context, /, config: str, store: Path, reverse: bool, repeat: float | None, **options: Any
) -> None:
    """Follow a taught path. Without a robot, the commands go to the sinks."""
    extra = (["start=last", "controller.reverse=true"] if reverse else []) + (
        [f"controller.repeat={repeat}"] if repeat is not None else []
    )
    if extra:
        _need_controller(context, config, options["overrides"], "--reverse" if reverse else "--repeat")
    options["overrides"] = (*options["overrides"], *extra)
    _execute(_request(context, config, options, store=store, mode="replay"), config, options)


def _need_controller(context: click.Context, config: str, overrides: tuple[str, ...], option: str) -> None:
    """Refuse an option that only a controller understands, where there is none."""
    from trailmark.config import load_run_config

    if load_run_config(config, plugins=plugins_of(context), overrides=overrides).controller is None:
        raise ConfigError(
            f"{option} is for the controller, and {config} has none; add a section 'controller:',"
            " for example controller: {plugin: path_tracking_4ws}"
        )


def _config_of(
    context: click.Context, target: str, localizers: tuple[str, ...], calibration: str | None
) -> str | dict[str, Any]:
    """Return the config file, or the config of a recording that is named alone."""
    from trailmark.cli.guess import guess_config, is_config

    if is_config(target):
        if localizers or calibration:
            raise ConfigError("--localizer and --calibration are for recordings without a config; use --set")
        return target
    config = guess_config(target, plugins_of(context).registry)
    if calibration is not None:
        (source,) = config["sources"].values()
        source["calibration"] = str(Path(calibration).resolve())
    return config | {"localizers": {name: {"plugin": name} for name in localizers}}


def _request(
    context: click.Context,
    config: str | dict[str, Any],
    options: Mapping[str, Any],
    *,
    store: Path | None,
    mode: Mode | None = None,
    access: Access | None = None,
) -> RunRequest:
    """Return what a command asks for: its config, the options that the three commands share, and its own."""
    from trailmark.pipeline import RunRequest

    shorthands = [f"{key}={options[key]}" for key in ("seed", "pace") if options[key] is not None]
    return RunRequest(
        config=config,
        out=options["out"],
        store=store,
        mode=mode,
        overrides=[*options["overrides"], *shorthands],
        plugins=plugins_of(context),
        access=access,
        overwrite=options["overwrite"],
    )


def _execute(request: RunRequest, target: str, options: Mapping[str, Any]) -> None:
    """Run what is asked for, with progress, and print what came of it."""
    from trailmark.api import run
    from trailmark.cli.guess import with_remedy
    from trailmark.cli.progress import RunProgress
    from trailmark.cli.without_effect import without_effect
    from trailmark.evaluation import RunWarning
    from trailmark.pipeline import link_latest, new_folder

    with with_remedy(request.config):
        config = request.read()
    for notice in config.notices:
        say(notice)
    if not config.sources:
        raise ConfigError(f"{target}: there are no sources, so no frames; add a section 'sources:'")
    folder = request.out or new_folder(Path(target).stem)
    has_report = not options["no_report"]
    with _page(options, Path(folder)) as notes, RunProgress(options["progress"]) as progress:
        on_step = progress if notes is None else _both(progress, notes)
        result = run(replace(request, config=config, out=folder), report=has_report, on_step=on_step)
    with shielded(TELL_S):
        if request.out is None:
            link_latest(Path(folder).absolute())
        _tell(result, Path(folder), options["as_json"], is_quiet=options["progress"] == "json", has_report=has_report)
        warnings = [RunWarning(**warning) for warning in result.metrics.get("warnings", ())]
        warnings += without_effect(config, Path(folder))
        for warning in warnings:
            say(f"WARNING: {warning}")
    if result.status == "interrupted":
        raise click.exceptions.Exit(130)
    if warnings and options["strict"]:
        say(f"failed because of --strict: the end has {len(warnings)} warning{'s' * (len(warnings) > 1)}")
        raise click.exceptions.Exit(1)


@contextmanager
def _page(options: Mapping[str, Any], folder: Path) -> Iterator[LiveNotes | None]:
    """Serve the page of the run if the options ask for it, and return what sends steps to it; print its address."""
    if options["port"] and not options["is_watched"]:
        raise ConfigError("--port is of the page that --watch serves")
    if not options["is_watched"] and options["notes"] is None:
        yield None
        return
    from trailmark.watching.beside import page_beside
    from trailmark.watching.notes import LiveNotes

    with ExitStack() as stack:
        where = options["notes"]
        if options["is_watched"]:
            url, where = stack.enter_context(page_beside(folder, options["port"]))
            say(f"watch it at {url}")
        yield stack.enter_context(LiveNotes(where))


def _both(first: OnStep, second: OnStep) -> OnStep:
    """Return a callback that passes a step to two others."""

    def on_step(pipeline: Pipeline, step: Step) -> None:
        first(pipeline, step)
        second(pipeline, step)

    return on_step


def _tell(result: RunResult, folder: Path, as_json: bool, is_quiet: bool, has_report: bool) -> None:
    """Print how the run ended: a row for each localizer, the folder, the report."""
    from trailmark.report.console import print_run, summary_rows

    if result.status != "done" or result.reason:
        say(f"run {result.status}" + (f": {result.reason}" if result.reason else ""))
    if as_json:
        rows = {"status": result.status, "reason": result.reason, "folder": str(folder), "rows": summary_rows(folder)}
        click.echo(json.dumps(rows, indent=1))
    elif not is_quiet:
        print_run(folder)
        click.echo(f"{folder}")
        if has_report and ending_signal() is None:
            click.echo(f"{folder / 'report.html'}")
