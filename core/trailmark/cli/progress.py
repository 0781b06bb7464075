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

__all__ = ["ProgressKind", "RunProgress", "way_text"]

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
        if not self._has_begun and self._kind != "none":
            for line in pipeline.sensor_origins:
                click.echo(line, err=True)
        self._has_begun = True
        self._n_frames += step.frame is not None
        if self._kind == "json":
            self._report_waypoints(pipeline, step)
        elif self._kind == "auto":
            self._show(step, _way_to_go_m(pipeline))

    def _report_waypoints(self, pipeline: Pipeline, step: Step) -> None:
        while self._n_waypoints < pipeline.n_waypoints:
            event = {"event": "waypoint", "index": self._n_waypoints, "stamp_s": step.stamp_s, "committed": True}
            click.echo(json.dumps(event))
            self._n_waypoints += 1

    def _show(self, step: Step, whole_m: float | None) -> None:
        now_s = time.monotonic()
        if self._n_frames <= 1:  # what came before was starting
            self._began_s = self._shown_s = now_s
        if now_s - self._shown_s < (_BAR_S if self._bar is not None else _LINE_S):
            return
        self._shown_s = now_s
        rate_hz = self._n_frames / max(now_s - self._began_s, 1e-9)
        way = way_text(step.belief.travelled_m, whole_m, now_s - self._began_s)
        text = f"{self._n_frames} frames, {way}, {rate_hz:.0f} frames/s"
        if self._bar is not None:
            self._bar.update(self._task, description=text)
        else:
            click.echo(text, err=True)


def way_text(travelled_m: float, whole_m: float | None, took_s: float) -> str:
    """Return the way so far; where the whole is known its share, and how long the rest takes at this pace."""
    if whole_m is None or not 0.0 < travelled_m < whole_m:
        return f"{travelled_m:.2f} m"
    left_s = took_s * (whole_m / travelled_m - 1.0)
    return f"{travelled_m:.2f} of {whole_m:.2f} m ({100.0 * travelled_m / whole_m:.0f} %, {left_s:.0f} s left)"


def _way_to_go_m(pipeline: Pipeline) -> float | None:
    """Return the length of the taught path that a run follows; None where there is none, or it is being taught [m]."""
    path = pipeline.path
    return None if path is None or len(path) < 2 or pipeline.n_waypoints else path.length_m


def _bar() -> Any:
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    from trailmark.report.terminal import TerminalConsole

    return Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        TimeElapsedColumn(),
        console=TerminalConsole(stderr=True),
        transient=True,
    )
