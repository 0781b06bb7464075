"""Pictures and scans that are an earlier one again, bit by bit, though the robot moves: a camera or driver that froze.

Sensors have noise: what repeats itself was not measured anew. A localizer that is shown it says again what it said
before, or that the robot stands, as sure as ever; so it is not asked, and `Lost` stands for its answer.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.estimates import Belief, Lost
from trailmark.frames import Frame
from trailmark.pipeline.localizers.estimator import EstimatorRunner
from trailmark.values import quick_dataclass

__all__ = ["FreezeWatch"]

#: What a robot moves by while it stands, by the noise of others [m, rad].
_RESTING_M, _RESTING_RAD = 0.002, math.radians(0.2)
#: So long the word of another that the robot moves or stands counts, and half of a sensor may be slower [s].
_RECENT_S = 0.5
#: One row of a picture in so many is kept and compared, and so many earlier ones: a driver may go round in its buffers.
_ROWS, _BUFFERS = 8, 4


@quick_dataclass(frozen=True, slots=True, eq=False)
class _Reading:
    """What a sensor measured, when it gave that first, and where the robot was then."""

    values: bytes
    stamp_s: float
    belief: Belief


class FreezeWatch:
    """Remembers what each sensor measured of late.

    Parameters
    ----------
    estimator : EstimatorRunner
        Tells how the robot has moved, and who says so.
    """

    def __init__(self, estimator: EstimatorRunner) -> None:
        self._estimator = estimator
        self._kept: dict[str, tuple[deque[_Reading], ...]] = {}
        self._new: list[tuple[deque[_Reading], bytes]] = []  # of the last frame that was looked at, and where it goes
        self._repeating: set[str] = set()

    def lost(self, frame: Frame) -> Lost | None:
        """Return what is said in place of those who look at a frame, where its sensor has frozen."""
        self._new.clear()
        readings = frame.payload.readings
        if not readings:
            self._repeating.discard(frame.sensor)
            return None
        repeated = self._repeated(frame.sensor, readings)
        if len(repeated) < len(readings):
            repeated = [one for one in repeated if frame.stamp_s - one.stamp_s > _RECENT_S]
        if not repeated:
            self._repeating.discard(frame.sensor)
            return None
        self._repeating.add(frame.sensor)
        for one in repeated:
            if reason := self._reason(frame, one.belief):
                return Lost(frame.stamp_s, f"{frame.sensor!r} gives the same {frame.payload.kind} again, {reason}")
        return None

    def _repeated(self, sensor: str, readings: tuple[AnyArray, ...]) -> list[_Reading]:
        """Return the earlier readings that came again, and set aside what is new."""
        if (kept := self._kept.get(sensor)) is None:
            kept = self._kept[sensor] = tuple(deque[_Reading](maxlen=_BUFFERS) for _ in readings)
        repeated = []
        for earlier, reading in zip(kept, readings):
            values = _measured(reading)
            same = next((one for one in earlier if one.values == values), None)  # most differ in their first bytes
            if same is not None and _tells_something(values, reading.dtype):
                repeated.append(same)
            else:
                self._new.append((earlier, values))
        return repeated

    def _reason(self, frame: Frame, before: Belief) -> str:
        """Return why a reading must not be the same again, or nothing."""
        if not self._estimator.has_motion_beside({frame.sensor, *self._repeating}, frame.stamp_s - _RECENT_S):
            return "bit by bit, and nobody else tells whether the robot stands"
        now = self._estimator.belief(frame.stamp_s)
        moves = [before.pose_odom_base.between(now.pose_odom_base)]
        if before.pose_map_base is not None and now.pose_map_base is not None:  # motion that came late moves this one
            moves.append(before.pose_map_base.between(now.pose_map_base))
        way_m, turn_rad = max(math.hypot(one.x, one.y) for one in moves), max(abs(one.theta) for one in moves)
        if way_m <= _RESTING_M and turn_rad <= _RESTING_RAD:
            return ""
        return f"bit by bit, while the robot moves by {way_m:.3f} m and {math.degrees(turn_rad):.1f} deg: frozen?"

    def keep(self, frame: Frame, belief: Belief) -> None:
        """Remember what the frame measured that was looked at last, and the belief after it.

        What came again is as old as it was.
        """
        for earlier, values in self._new:
            earlier.append(_Reading(values, frame.stamp_s, belief))
        self._new.clear()


def _measured(reading: AnyArray) -> bytes:
    """Return enough of a reading to know it again: a copy, for a source may write into its arrays anew."""
    return (reading[::_ROWS] if reading.ndim > 1 else reading).tobytes()


def _tells_something(values: bytes, dtype: np.dtype[Any]) -> bool:
    """Return whether what is kept of a reading is not all the same, as a black picture or a scan without an echo."""
    if dtype.kind in "iub":  # of whole numbers those alike have the same bytes: what is shifted by one is the same
        return values[dtype.itemsize :] != values[: -dtype.itemsize]
    told = np.frombuffer(values, dtype)
    told = told[np.isfinite(told)]
    return bool(told.size) and bool((told != told[0]).any())
