"""Pictures and scans that are an earlier one again, bit by bit, though the robot moves: a camera or driver that froze.

Sensors have noise: what repeats itself was not measured anew. A localizer that is shown it says again what it said
before, or that the robot stands, as sure as ever; so it is not asked, and `Lost` stands for its answer.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.estimates import Belief, Lost
from trailmark.frames import Frame, Payload
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

    values: AnyArray
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
        self._kept: dict[str, list[deque[_Reading]]] = {}
        self._repeating: set[str] = set()

    def lost(self, frame: Frame) -> Lost | None:
        """Return what is said in place of those who look at a frame, where its sensor has frozen."""
        now = _measured(frame.payload)
        found = [_found(kept, values) for kept, values in zip(self._kept.get(frame.sensor, ()), now)]
        repeated = [one for one in found if one is not None]
        if len(repeated) < len(now):
            repeated = [one for one in repeated if frame.stamp_s - one.stamp_s > _RECENT_S]
        if repeated:
            self._repeating.add(frame.sensor)
        else:
            self._repeating.discard(frame.sensor)
        for one in repeated:
            if reason := self._reason(frame, one.belief):
                return Lost(frame.stamp_s, f"{frame.sensor!r} gives the same {frame.payload.kind} again, {reason}")
        return None

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
        """Remember what a frame measured, and the belief after it; what is the same is as old as it was."""
        now = _measured(frame.payload)
        kept = self._kept.setdefault(frame.sensor, [deque(maxlen=_BUFFERS) for _ in now])
        for earlier, values in zip(kept, now):
            if _found(earlier, values) is None:
                earlier.append(_Reading(values, frame.stamp_s, belief))


def _measured(payload: Payload) -> list[AnyArray]:
    """Return enough of what was measured to know it again: copies, for a source may write into its arrays anew."""
    return [np.array(reading[::_ROWS] if reading.ndim > 1 else reading) for reading in payload.readings]


def _found(earlier: deque[_Reading], now: AnyArray) -> _Reading | None:
    """Return the earlier reading that is the same; None for one that says nothing, as a black picture."""
    same = next((one for one in earlier if _is_same(one.values, now)), None)
    if same is None:
        return None
    told = now[np.isfinite(now)]
    return same if len(told) and (told != told[0]).any() else None


def _is_same(before: AnyArray, now: AnyArray) -> bool:
    """Return whether two readings are equal bit by bit, NaN as well; most differ in their first row."""
    is_like = before.shape == now.shape and before[:1].tobytes() == now[:1].tobytes()
    return is_like and before.tobytes() == now.tobytes()
