"""How far a bench is: a live table on a terminal, a line for each cell elsewhere. On standard error."""

from __future__ import annotations

import sys
import time
from contextlib import AbstractContextManager
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from trailmark.cli.errors import say

if TYPE_CHECKING:
    from trailmark_bench.scheduler import BenchStatus

__all__ = ["BenchProgress", "duration_text"]

_ORDER = ("ok", "failed", "timeout", "crashed", "skipped", "running", "pending")
_COLOURS = {"ok": "green", "failed": "red", "timeout": "red", "crashed": "red", "skipped": "dim", "running": "cyan"}
_RECENT = 5


class BenchProgress(AbstractContextManager["BenchProgress"]):
    """Tells how a bench goes on; pass it as ``on_progress`` to `trailmark_bench.run_bench`."""

    def __init__(self) -> None:
        self._live: Any = None
        self._began: dict[str, float] = {}
        self._recent: list[tuple[str, str, str]] = []

    def __enter__(self) -> Self:
        if sys.stderr.isatty():
            from rich.live import Live

            from trailmark.report.terminal import TerminalConsole

            self._live = Live(console=TerminalConsole(stderr=True), refresh_per_second=4, transient=True)
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def __call__(self, progress: BenchStatus) -> None:
        """Take note of where the bench is."""
        now_s = time.monotonic()
        ids = {cell.id for cell in progress.running}
        self._began = {cell_id: self._began.get(cell_id, now_s) for cell_id in ids}
        if progress.finished is not None:
            self._recent = [*self._recent, (progress.state, progress.finished.label, progress.reason)][-_RECENT:]
        if self._live is not None:
            self._live.update(self._table(progress, now_s))
        elif progress.finished is not None:
            say(self._line(progress))

    def _line(self, progress: BenchStatus) -> str:
        done, total = _count_ended(progress), sum(progress.states.values())
        left = "" if progress.left_s is None or done == total else f", about {duration_text(progress.left_s)} left"
        assert progress.finished is not None
        why = f": {progress.reason}" if progress.reason else ""
        return f"{done}/{total} {progress.state:<7} {progress.finished.label}{why}{left}"

    def _table(self, progress: BenchStatus, now_s: float) -> Any:
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        done, total = _count_ended(progress), max(1, sum(progress.states.values()))
        grid = Table.grid(padding=(0, 1))
        counts = Text("  ").join(
            Text(f"{progress.states[state]} {state}", style=_COLOURS.get(state, ""))
            for state in _ORDER
            if progress.states.get(state)
        )
        left = "" if progress.left_s is None else f"about {duration_text(progress.left_s)} left"
        grid.add_row(ProgressBar(total=total, completed=done, width=30), Text(f"{done}/{total}  {left}"))
        grid.add_row(counts)
        for cell in progress.running:
            grid.add_row(Text(cell.label, style="cyan"), Text(duration_text(now_s - self._began[cell.id])))
        for state, label, reason in self._recent:
            grid.add_row(Text(label, style="dim"), Text(f"{state} {reason}"[:80], style=_COLOURS.get(state, "")))
        return grid


def duration_text(seconds: float) -> str:
    """Return a duration in the unit that suits it."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    if seconds < 120:
        return f"{seconds:.0f} s"
    if seconds < 7200:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


def _count_ended(progress: BenchStatus) -> int:
    return sum(count for state, count in progress.states.items() if state not in ("pending", "running"))
