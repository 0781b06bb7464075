"""``trailmark watch``: a run, or a bench, while it goes on; or a robot, with buttons."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from trailmark.cli.errors import say
from trailmark.cli.root import command_of_plugin, plugin_options, plugins_of
from trailmark.errors import ConfigError, DataError

if TYPE_CHECKING:
    from trailmark.report.live import RunWatch

__all__ = ["Look", "watch", "watch_command", "watch_options"]

_LINE_S = 5.0

#: Looks once: whether it still goes on, and what to show.
Look = Callable[[], tuple[bool, Any]]


def watch_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command that watches something its options."""
    pause = click.FloatRange(0.05)
    every = click.option("--every", default=0.5, show_default=True, type=pause, help="Look so often [s].")
    return every(click.option("--once", is_flag=True, help="Look once.")(command))


@click.command("watch")
@click.argument("folder", metavar="[RUN|CONFIG]", default=Path("runs/latest"), type=click.Path(path_type=Path))
@watch_options
@click.option("--page", "as_page", is_flag=True, help="Serve a page on this machine that shows the run.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Of the page; default: one that is free.")
@click.option("--store", type=click.Path(path_type=Path), help="Of a robot: the path store, written and followed.")
@click.option(
    "--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Of a robot: override a key of the config."
)
@click.pass_context
def watch_command(
    context: click.Context, /, folder: Path, every: float, once: bool, as_page: bool, port: int, **robot: Any
) -> None:
    """Watch a run (or a bench) from its folder while it goes on; default: runs/latest.

    A run writes its estimates some forty at a time. With the CONFIG of a robot and a --store, the page has buttons:
    teach, replay and stop.
    """
    from trailmark.cli.guess import is_config

    if is_config(str(folder)):
        _watch_robot(context, folder, port, **robot)
    elif robot["store"] is not None or robot["overrides"]:
        raise ConfigError(f"--store and --set are for the config of a robot, and {folder} is none")
    elif as_page:
        _watch_page(folder, port)
    elif (folder / "index.sqlite").is_file():
        context.invoke(command_of_plugin(context, "bench", "watch"), folder=folder, every=every, once=once)
    else:
        watch(_run(folder), every, once)


def _watch_page(folder: Path, port: int) -> None:
    """Serve the page of a run until it has ended."""
    from trailmark.watching.beside import serve_page
    from trailmark.watching.watched import WatchedRun

    watch = _run_of(folder)
    if watch.read_status() != "running":
        report = folder / "report.html"
        next_step = f"open {report}" if report.is_file() else f"'trailmark report {folder}' makes its report"
        raise DataError(f"the run in {folder} has ended: {next_step}")
    serve_page(lambda secret: WatchedRun(folder, secret), port, tell=_tell_address)


def _watch_robot(
    context: click.Context, config: Path, port: int, store: Path | None, overrides: tuple[str, ...]
) -> None:
    """Serve a page that teaches, replays and stops."""
    from trailmark.config import load_run_config
    from trailmark.interfaces import Drivable
    from trailmark.isolation.tasks import Task, task_command
    from trailmark.pipeline import new_folder
    from trailmark.watching.beside import serve_page
    from trailmark.watching.robot import WatchedRobot

    if store is None:
        raise ConfigError(f"--store is missing: where the path that {config} teaches and replays is kept")
    run = load_run_config(config, plugins=plugins_of(context), overrides=overrides)
    if not any(isinstance(entry.construct(), Drivable) for entry in run.sources.values()):
        raise ConfigError(f"{config} has no robot to teach and replay; 'trailmark run {config} --watch' shows its run")
    chosen = plugin_options(context)

    def command_of(task: Task, folder: Path, notes: Path) -> list[str]:
        extra = ["--out", str(folder), "--notes", str(notes), "--progress", "none", *chosen]
        return task_command(task, config, store, settings=overrides, extra=extra)

    def folder_of(task: Task) -> Path:
        return new_folder(f"{config.stem}-{task}")

    serve_page(lambda secret: WatchedRobot(config.name, secret, command_of, folder_of), port, tell=_tell_address)


def _tell_address(url: str) -> None:
    say(f"watch it at {url}")


def watch(look: Look, every: float, once: bool) -> None:
    """Show what is watched until it has ended: live on a terminal, in lines elsewhere.

    Parameters
    ----------
    look : callable
        Looks once.
    every : float
        Time between looks [s].
    once : bool
        Look once only.
    """
    if once or not sys.stdout.isatty():
        _tell_in_lines(look, every, once)
        return
    from rich.live import Live

    goes_on, shown = look()
    with Live(shown, refresh_per_second=4) as live:
        while goes_on:
            time.sleep(every)
            goes_on, shown = look()
            live.update(shown)


def _tell_in_lines(look: Look, every: float, once: bool) -> None:
    from trailmark.report.console import table_console

    console, told_s = table_console(), 0.0
    while True:
        goes_on, shown = look()
        if once or not goes_on or time.monotonic() - told_s > _LINE_S:
            console.print(shown)
            told_s = time.monotonic()
        if once or not goes_on:
            return
        time.sleep(every)


def _run(folder: Path) -> Look:
    from rich.console import Group
    from rich.text import Text

    from trailmark.report.console import to_rich

    watch = _run_of(folder)

    def look() -> tuple[bool, Any]:
        goes_on = watch.look()
        line = Text(f"{folder.resolve().name}: {watch.status}")
        return goes_on, Group(line, to_rich(watch.table())) if watch.localizers else line

    return look


def _run_of(folder: Path) -> RunWatch:
    from trailmark.report.live import RunWatch

    if not folder.is_dir():
        raise DataError(f"no folder {folder}: name the folder of a run, as its command prints it")
    return RunWatch(folder)
