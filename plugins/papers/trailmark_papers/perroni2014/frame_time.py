"""What a picture costs: a difference, a new change vector, and its shift (Sec. V: "remarkably fast")."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from trailmark.arrays import Floats, Grey8
from trailmark.experiments import ExperimentOptions, Row
from trailmark_divs.layout import ColumnLayout, make_layout
from trailmark_divs.robust_shift import local_windows, shift_scores
from trailmark_divs.stream import ChangeStream
from trailmark_divs.tracking import ShiftTracker
from trailmark_divs.warm_up import compile_kernels
from trailmark_papers.kit import Table
from trailmark_papers.perroni2014.drives import STREAMS, Place
from trailmark_papers.perroni2014.pictures import upper_halves

__all__ = ["frame_time_rows"]

_WINDOW, _COLUMNS, _CORRELATION_WINDOW, _MAX_SHIFT = 25, 50, 5, 20
_WAY_M = 1.0
_ROUNDS = 10


def frame_time_rows(options: ExperimentOptions) -> list[Row]:
    """Return the time per picture of 640 x 480 on one core, in thread CPU time."""
    layout, keeper = make_layout((640, 480), _COLUMNS, (0.0, 0.5)), upper_halves()
    place = Place("street", _WAY_M, 640, world_seed=options.world_seed)
    place.teach(options.out / "runs" / "time", {"streams": STREAMS}, options.seed, on_step=keeper)
    compile_kernels()
    times_ms = [time_ms for _ in range(_ROUNDS) for time_ms in _times_ms(keeper.values, layout)]
    median_ms = float(np.median(times_ms))
    options.report(f"change vector and shift: {median_ms:.3f} ms")
    note = "paper: 40,000 cycles of a 2.67 GHz processor are 0.015 ms; it also says 40 ms. Grey pictures, median."
    table = Table("time per picture, 640 x 480", len(times_ms))
    table.add("change vector and shift, one core", "ms", median_ms, paper=40.0, bar=0.15, stretch=0.10, note=note)
    table.add("the same, 95th percentile", "ms", float(np.percentile(times_ms, 95)))
    return table.rows


def _times_ms(greys: Sequence[Grey8], layout: ColumnLayout) -> list[float]:
    """Return the time of every picture from the first full window on, against the first window as the taught one."""
    stream, tracker = ChangeStream(layout, _WINDOW, "p90", "trimmed"), ShiftTracker(_MAX_SHIFT, _WINDOW)
    taught: Floats | None = None
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
