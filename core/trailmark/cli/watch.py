"""``trailmark watch``: a run, or a bench, while it goes on."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from trailmark.cli.root import command_of_plugin
from trailmark.errors import DataError

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
@click.argument("folder", metavar="[RUN]", default=Path("runs/latest"), type=click.Path(path_type=Path))
@watch_options
@click.pass_context
def watch_command(context: click.Context, folder: Path, every: float, once: bool) -> None:
    """Watch a run (or a bench) from its folder while it goes on; default: runs/latest.

    A run writes its estimates some forty at a time.
    """
    if (folder / "index.sqlite").is_file():
        context.invoke(command_of_plugin(context, "bench", "watch"), folder=folder, every=every, once=once)
    else:
        watch(_run(folder), every, once)


def watch(look: Look, every: float, once: bool) -> None:
    """Look again and again until what is watched has ended: live on a terminal, in lines elsewhere.

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
    from trailmark.report.live import RunWatch

    if not folder.is_dir():
        raise DataError(f"no folder {folder}: name the folder of a run, as its command prints it")
    watch = RunWatch(folder)

    def look() -> tuple[bool, Any]:
        goes_on = watch.look()
        line = Text(f"{folder.resolve().name}: {watch.status}")
        return goes_on, Group(line, to_rich(watch.table())) if watch.localizers else line

    return look
