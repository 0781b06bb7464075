"""How far a run is: a bar on a terminal, plain lines elsewhere, or JSON for other programs. On standard error."""

from __future__ import annotations

import json
import sys
import time
from contextlib import AbstractContextManager
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, Self

import click

if TYPE_CHECKING:
    from trailmark.pipeline import Pipeline, Step

__all__ = ["ProgressKind", "RunProgress", "share_text"]

ProgressKind = Literal["auto", "json", "none"]

_BAR_S = 0.1
_LINE_S = 5.0


class RunProgress(AbstractContextManager["RunProgress"]):
    """Shows how a run goes on; pass it as ``on_step`` to `trailmark.run`.

    With ``json``, a line of JSON on standard output for every waypoint, written when it is committed: what
    was read there survives whatever happens next.

    Parameters
    ----------
    kind : ProgressKind
        A bar, lines of JSON, or nothing.
    """

    def __init__(self, kind: ProgressKind) -> None:
        self._kind = kind
        self._bar: Any = None
        self._n_frames = 0
        self._n_waypoints = 0
        self._has_begun = False
        self._first_s = 0.0
        self._lasts_s: float | None = None
        self._began_s = self._shown_s = time.monotonic()

    def __enter__(self) -> Self:
        if self._kind == "auto" and sys.stderr.isatty():
            self._bar = _bar()
            self._bar.start()
            self._task = self._bar.add_task("", total=None)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, pipeline: Pipeline, step: Step) -> None:
        """Take note of a step; with the first one say what was taken from the recording."""
        if not self._has_begun:
            self._begin(pipeline, step)
        self._n_frames += step.frame is not None
        if self._kind == "json":
            self._report_waypoints(pipeline, step)
        elif self._kind == "auto":
            self._show(pipeline, step)

    def _begin(self, pipeline: Pipeline, step: Step) -> None:
        self._has_begun = True
        self._first_s = step.stamp_s
        if self._kind == "auto":
            self._lasts_s = pipeline.lasts_s
        if self._kind != "none":
            for line in pipeline.sensor_origins:
                click.echo(line, err=True)

    def _share(self, pipeline: Pipeline, step: Step) -> float | None:
        """Return how much of the run is done: of its time or of the taught path it follows, whichever ends it first."""
        shares = []
        if self._lasts_s:
            shares.append((step.stamp_s - self._first_s) / self._lasts_s)
        path = pipeline.path
        if path is None or len(path) < 2 or pipeline.n_waypoints:  # one that is being taught has no end yet
            return max(shares, default=None)
        if pipeline.parts.controller is not None or not shares:
            shares.append(step.belief.travelled_m / path.length_m)
        return max(shares)

    def _report_waypoints(self, pipeline: Pipeline, step: Step) -> None:
        while self._n_waypoints < pipeline.n_waypoints:
            event = {"event": "waypoint", "index": self._n_waypoints, "stamp_s": step.stamp_s, "committed": True}
            click.echo(json.dumps(event))
            self._n_waypoints += 1

    def _show(self, pipeline: Pipeline, step: Step) -> None:
        now_s = time.monotonic()
        if self._n_frames <= 1:  # what came before was starting
            self._began_s = self._shown_s = now_s
        if now_s - self._shown_s < (_BAR_S if self._bar is not None else _LINE_S):
            return
        self._shown_s = now_s
        rate_hz = self._n_frames / max(now_s - self._began_s, 1e-9)
        share = self._share(pipeline, step)
        done = share_text(share, now_s - self._began_s)
        text = f"{done}{self._n_frames} frames, {step.belief.travelled_m:.2f} m, {rate_hz:.0f} frames/s"
        if self._bar is not None:
            completed = min(share or 0.0, 0.999)  # of a task that is done the time stands still
            self._bar.update(self._task, description=text, completed=completed, total=1.0 if done else None)
        else:
            click.echo(text, err=True)


def share_text(share: float | None, took_s: float) -> str:
    """Return how much is done and how long the rest takes at this pace; nothing where it cannot be foreseen."""
    if share is None or not 0.0 < share < 1.0:
        return ""
    return f"{100.0 * share:.0f} %, {took_s * (1.0 / share - 1.0):.0f} s left: "


def _bar() -> Any:
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from trailmark.report.terminal import TerminalConsole

    return Progress(
        BarColumn(bar_width=20),  # it runs to and fro where the end is not known
        TextColumn("{task.description}"),
        TimeElapsedColumn(),
        console=TerminalConsole(stderr=True),
        transient=True,
    )
