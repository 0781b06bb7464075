"""``trailmark watch``: a run, or a bench, while it goes on."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from trailmark.errors import DataError

__all__ = ["watch_command"]

_LINE_S = 5.0


@click.command("watch")
@click.argument("folder", metavar="[RUN]", default=Path("runs/latest"), type=click.Path(path_type=Path))
@click.option("--every", default=0.5, show_default=True, type=click.FloatRange(0.05), help="Look so often [s].")
@click.option("--once", is_flag=True, help="Look once.")
def watch_command(folder: Path, every: float, once: bool) -> None:
    """Watch a run (or a bench) from its folder while it goes on; default: runs/latest.

    A run writes its estimates some forty at a time.
    """
    look = _bench(folder) if (folder / "index.sqlite").is_file() else _run(folder)
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


#: Looks once: whether it still goes on, and what to show.
_Look = Callable[[], tuple[bool, Any]]


def _tell_in_lines(look: _Look, every: float, once: bool) -> None:
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


def _run(folder: Path) -> _Look:
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


def _bench(folder: Path) -> _Look:
    from rich.text import Text

    from trailmark.bench.index import Index

    def look() -> tuple[bool, Any]:
        with Index(folder) as index:
            records = index.records()
        counts: dict[str, int] = {}
        for record in records:
            counts[record.state] = counts.get(record.state, 0) + 1
        states = ", ".join(f"{count} {state}" for state, count in counts.items())
        running = "".join(f"\n  {record.label}" for record in records if record.state == "running")
        goes_on = bool(counts.get("running"))
        return goes_on, Text(f"{folder.resolve().name}: {states}{running}")

    return look
