"""What the frames of a source must be: of its sensors, of one kind and size, and in the order of time."""

from __future__ import annotations

import logging
import math
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from itertools import chain, islice
from typing import Any

from trailmark.errors import SourceError
from trailmark.frames import PAYLOAD_KINDS, Frame, Payload, Record, SensorInfo, payload_kind
from trailmark.pipeline.instruments import Counters

__all__ = ["FrameChecks", "without_future"]

logger = logging.getLogger(__name__)

# A recording may pause; a frame that is so far ahead of the one before is looked at with those after it.
_AHEAD_S = 10.0
_WAITING = 3

# What tells one problem of a kind from another.
_NUMBER = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")

# No recording pauses for a year.
_ABSURD_S = 3.2e7


class FrameChecks:
    """Looks at every frame of one source.

    Parameters
    ----------
    source : str
        Its name.
    sensors : mapping of str to SensorInfo
        Its sensors.
    skips : bool
        Whether a bad frame is left out and counted, or an error.
    counters : Counters
        Takes ``source.NAME.repeated`` and ``source.NAME.skipped``.
    remedy : str
        What to do about a bad frame, at the end of the message; none for frames that a program pushes.

    Attributes
    ----------
    are_in_order : bool
        Whether a frame may not be older than one of another sensor before it; False where somebody puts them in order.
    """

    def __init__(
        self,
        source: str,
        sensors: Mapping[str, SensorInfo],
        skips: bool,
        counters: Counters,
        remedy: str = "; 'on_bad_frame: skip' leaves such frames out",
    ) -> None:
        self._source = source
        self._checks = {sensor: _Check(info) for sensor, info in sensors.items()}
        self._skips = skips
        self._counters = counters
        self._remedy = remedy
        self._told: set[tuple[str, str]] = set()  # sensors and kinds of problem of which a skipped frame was told
        self._last_s = -math.inf
        self.are_in_order = True

    def without_future(self, frames: Iterator[Frame]) -> Iterator[Frame]:
        """Yield the frames without those of the future, see `without_future`; they are counted as skipped."""
        return without_future(frames, lambda frame: self._skip(frame, "is of the future: those after it are older"))

    def timely(self, frames: Iterator[Frame], now_s: Callable[[], float]) -> Iterator[Frame]:
        """Yield live frames, and refuse those whose stamps are ahead of the others of their sensor by our clock.

        Parameters
        ----------
        frames : iterator of Frame
            As the device gives them.
        now_s : callable
            Returns the time by our clock [s].

        Raises
        ------
        SourceError
            If such a frame is not to be skipped, or was the first: the run would wait for its time to come.
        """
        from trailmark.sources.clock_offset import ClockOffset  # recordings need none

        clocks: defaultdict[str, ClockOffset] = defaultdict(ClockOffset)
        for frame in frames:
            clock = clocks[frame.sensor]
            ahead_s = clock.note_message(frame.stamp_s, now_s())
            if clock.begun_ahead_s:
                raise SourceError(
                    f"source {self._source!r}: the first frame of {frame.sensor!r} was {clock.begun_ahead_s:.0f} s"
                    " ahead of all after it, and the run began at its stamp; begin anew"
                )
            if ahead_s:
                self._refuse(frame, f"is {ahead_s:.0f} s ahead of those before it")
            else:
                yield frame

    def accept(self, frame: Frame) -> bool:
        """Return whether a frame is good; one that repeats the stamp of its sensor is left out and counted.

        Raises
        ------
        SourceError
            If the frame is bad, and bad frames are not to be skipped.
        """
        check = self._checks.get(frame.sensor)
        if check is None:
            return self._refuse(frame, f"is of none of its sensors ({', '.join(self._checks)})")
        if frame.stamp_s == check.last_s:
            self._counters[f"source.{self._source}.repeated"] += 1
            return False
        problem = check.problem(frame)
        if problem is None and self.are_in_order and frame.stamp_s < self._last_s:
            problem = f"is older than the source's frame before it ({self._last_s:.6f} s)"
        if problem is not None:
            return self._refuse(frame, problem)
        check.last_s = self._last_s = frame.stamp_s
        return True

    def _refuse(self, frame: Frame, problem: str) -> bool:
        if not self._skips:
            raise SourceError(f"{self._problem_text(frame, problem)}{self._remedy}")
        self._skip(frame, problem)
        return False

    def _skip(self, frame: Frame, problem: str) -> None:
        self._counters[f"source.{self._source}.skipped"] += 1
        told = frame.sensor, _NUMBER.sub("", problem)
        if told in self._told:
            logger.debug("skipped: %s", self._problem_text(frame, problem))
            return
        self._told.add(told)
        logger.warning("%s; it is skipped, others like it silently", self._problem_text(frame, problem))

    def _problem_text(self, frame: Frame, problem: str) -> str:
        return f"source {self._source!r}: the frame of {frame.sensor!r} at {frame.stamp_s:.6f} s {problem}"


def without_future(frames: Iterator[Frame], skip: Callable[[Frame], None]) -> Iterator[Frame]:
    """Yield the frames without those whose stamp is far ahead of the frames after them.

    A frame that jumps ahead waits, with up to two more, for the frames after it: if these come back, it is skipped; if
    they go on from there, time has passed. So one wrong clock costs its own frames, and not all that follow.

    Parameters
    ----------
    frames : iterator of Frame
        As the source gives them.
    skip : callable
        Is told of each that is left out.
    """
    waiting: list[Frame] = list(islice(frames, _WAITING))
    if len(waiting) == _WAITING and all(frame.stamp_s < waiting[0].stamp_s - _AHEAD_S for frame in waiting[1:]):
        skip(waiting.pop(0))
    last_s = waiting[0].stamp_s if waiting else 0.0
    frames, waiting = chain(waiting, frames), []
    for frame in frames:
        if frame.stamp_s > last_s + _AHEAD_S:
            waiting.append(frame)
            if len(waiting) < _WAITING:
                continue
        elif waiting:
            for wrong in waiting:
                skip(wrong)
            waiting = []
        for passed in waiting or (frame,):
            last_s = max(last_s, passed.stamp_s)
            yield passed
        waiting = []
    for late in waiting:  # nothing came after them: they may be right
        if late.stamp_s < last_s + _ABSURD_S:
            yield late
        else:
            skip(late)


class _Check:
    """What the frames of one sensor must be, and the stamp of the last."""

    def __init__(self, info: SensorInfo) -> None:
        self._kind = info.kind
        self._payload = PAYLOAD_KINDS.get(info.kind, Record)
        self._has_layout = self._payload.layout is not Payload.layout  # of odometry and the like nobody need ask
        self._size = info.size
        self._layout: Any = None
        self.last_s = -math.inf

    def problem(self, frame: Frame) -> str | None:
        """Return what is wrong with the next frame of the sensor."""
        payload = frame.payload
        if not isinstance(payload, self._payload):
            return f"carries {payload_kind(payload)}, but the sensor is of kind {self._kind}"
        layout = payload.layout if self._has_layout else None
        if layout != self._layout:
            if self._layout is not None:
                return f"changes from {_layout_text(self._layout)} to {_layout_text(layout)}"
            size = payload.size
            if self._size is not None and size is not None and size != self._size:
                return f"is {size[0]}x{size[1]} px, but the sensor is {self._size[0]}x{self._size[1]} px"
            self._layout = layout
        if frame.stamp_s < self.last_s:
            return f"goes back in time: the one before it was at {self.last_s:.6f} s"
        return None


def _layout_text(layout: Any) -> str:
    return " ".join(str(item) for item in layout)
