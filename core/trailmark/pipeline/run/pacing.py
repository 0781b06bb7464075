"""What a run goes on with: the frames of its sources and the controller's ticks, as the pace says."""

from __future__ import annotations

import math
from collections.abc import Iterator

from trailmark.frames import Frame
from trailmark.pipeline.ending import HangWatch
from trailmark.pipeline.instruments import Instruments
from trailmark.pipeline.sources.merging import merge_sources
from trailmark.pipeline.sources.realtime import Event, held_to_stamps, live
from trailmark.pipeline.startup import RunningParts

__all__ = ["realtime_events"]


def realtime_events(running: RunningParts, instruments: Instruments, hangs: HangWatch) -> Iterator[Event]:
    """Yield frames and the controller's ticks of a run in real time.

    Parameters
    ----------
    running : RunningParts
        The parts, started.
    instruments : Instruments
        Of the run: its clock and its counters.
    hangs : HangWatch
        Interrupts a recorded source that does not come back; one that waits for its time is not meant.
    """
    parts, control = running.parts, running.control
    due_s = (lambda: math.inf) if control is None else (lambda: control.due_s)
    if parts.is_live:
        return live(parts.sources, instruments.clock, due_s, instruments.counters)
    frames = _watch_frames(merge_sources(parts.sources), hangs)
    if parts.robot is not None:  # simulated: when its frame is there, it has moved on already
        return held_to_stamps(frames, instruments.clock, lambda: math.inf)
    return held_to_stamps(frames, instruments.clock, due_s)


def _watch_frames(frames: Iterator[Frame], hangs: HangWatch) -> Iterator[Frame]:
    while True:
        with hangs:
            frame = next(frames, None)
        if frame is None:
            return
        yield frame
