"""What a picture costs: a difference, a new change vector, and its shift (Sec. V: "remarkably fast")."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.experiments import ExperimentOptions, Row
from trailmark.frames import Image
from trailmark.pipeline import Pipeline, Step
from trailmark_divs.layout import Layout, grey_region, make_layout
from trailmark_divs.robust_shift import local_windows, shift_scores
from trailmark_divs.stream import ChangeStream
from trailmark_divs.tracking import ShiftTracker
from trailmark_divs.warm_up import compile_kernels
from trailmark_papers.perroni2014.drives import STREAMS, Place, teach

__all__ = ["frame_time_rows"]

_WINDOW, _COLUMNS, _CORRELATION_WINDOW, _MAX_SHIFT = 25, 50, 5, 20
_WAY_M = 1.0
_ROUNDS = 10


def frame_time_rows(options: ExperimentOptions) -> list[Row]:
    """Return the time per picture of 640 x 480 on one core, in thread CPU time."""
    pictures = _pictures(options)
    layout = make_layout((640, 480), _COLUMNS, (0.0, 0.5))
    greys = [grey_region(picture, layout.rows) for picture in pictures]
    compile_kernels()
    times_ms = [time_ms for _ in range(_ROUNDS) for time_ms in _times_ms(greys, layout)]
    median_ms = float(np.median(times_ms))
    options.report(f"change vector and shift: {median_ms:.3f} ms")
    note = "paper: 40,000 cycles of a 2.67 GHz processor are 0.015 ms; it also says 40 ms. Grey pictures, median."
    common: dict[str, Any] = {"n": len(times_ms)}
    name = "time per picture, 640 x 480"
    return [
        Row(name, "change vector and shift, one core", "ms", median_ms, 40.0, 0.15, 0.10, note=note, **common),
        Row(name, "the same, 95th percentile", "ms", float(np.percentile(times_ms, 95)), **common),
    ]


def _pictures(options: ExperimentOptions) -> list[Image]:
    found: list[Image] = []

    def keep(_: Pipeline, step: Step) -> None:
        if step.frame is not None and isinstance(step.frame.payload, Image):
            found.append(step.frame.payload)

    teach(options.out / "runs" / "time", Place("street", _WAY_M, 640), {"streams": STREAMS}, options.seed, keep)
    return found


def _times_ms(greys: Sequence[npt.NDArray[np.uint8]], layout: Layout) -> list[float]:
    """Return the time of every picture from the first full window on, against the first window as the taught one."""
    stream, tracker = ChangeStream(layout, _WINDOW, "p90", "trimmed"), ShiftTracker(_MAX_SHIFT, _WINDOW)
    taught: npt.NDArray[np.float64] | None = None
    times_ms = []
    for grey in greys:
        began_ns = time.thread_time_ns()
        stream.push(grey)
        if not stream.is_full:
            continue
        vector = stream.vector()
        windows = local_windows(vector, layout.usable, _CORRELATION_WINDOW)
        if taught is None:
            taught = vector
            continue
        against = local_windows(taught, layout.usable, _CORRELATION_WINDOW)
        tracker.update(shift_scores(against, windows, _MAX_SHIFT))
        times_ms.append((time.thread_time_ns() - began_ns) / 1e6)
    return times_ms
