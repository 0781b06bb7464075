"""Pictures and scans that are the one before again, bit by bit, though the robot moves: a camera or driver that froze.

Sensors have noise: what repeats itself was not measured anew. A localizer that is shown it says again what it said
before, or that the robot stands, as sure as ever; so it is not asked, and `Lost` stands for its answer.
"""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.estimates import Belief, Lost
from trailmark.frames import Frame, Payload
from trailmark.geometry import Pose2
from trailmark.pipeline.localizers.estimator import EstimatorRunner
from trailmark.values import quick_dataclass

__all__ = ["RepeatWatch"]

#: What a robot moves by while it stands, by the noise of others [m, rad].
_RESTING_M, _RESTING_RAD = 0.02, math.radians(1.0)
#: So long a sensor may repeat itself where nobody else tells of motion [s].
_UNTOLD_S = 0.5
#: One row of a picture in so many is kept and compared.
_ROWS = 8


@quick_dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """What a sensor gave, when it gave it first, and where odometry was then."""

    readings: tuple[AnyArray, ...]
    stamp_s: float
    pose_odom_base: Pose2


class RepeatWatch:
    """Remembers what each sensor gave last.

    Parameters
    ----------
    estimator : EstimatorRunner
        Tells how the robot has moved, and who else says so.
    """

    def __init__(self, estimator: EstimatorRunner) -> None:
        self._estimator = estimator
        self._seen: dict[str, _Seen] = {}
        self._fresh: tuple[AnyArray, ...] | None = None  # of the frame that was looked at last; None: a repeat

    def lost(self, frame: Frame) -> Lost | None:
        """Return what is said in place of all who look at a frame, where it repeats the one before and must not."""
        self._fresh = _readings(frame.payload)
        seen = self._seen.get(frame.sensor)
        if seen is None or not any(map(_is_same, seen.readings, self._fresh)):
            return None
        self._fresh = None
        belief = self._estimator.belief(frame.stamp_s)
        moved = seen.pose_odom_base.between(belief.pose_odom_base)
        way_m, turn_deg = math.hypot(moved.x, moved.y), math.degrees(abs(moved.theta))
        what = f"{frame.sensor!r} gives the same {frame.payload.kind} again, bit by bit"
        if way_m > _RESTING_M or abs(moved.theta) > _RESTING_RAD:
            return Lost(
                frame.stamp_s, f"{what}, while the robot moves by {way_m:.2f} m and {turn_deg:.0f} deg: frozen?"
            )
        since_s = frame.stamp_s - seen.stamp_s
        if since_s > _UNTOLD_S and not self._estimator.has_motion_beside(frame.sensor):
            return Lost(frame.stamp_s, f"{what}, for {since_s:.1f} s, and nobody else tells whether the robot stands")
        return None

    def keep(self, frame: Frame, belief: Belief) -> None:
        """Remember the frame that was looked at last, and the belief after it."""
        if self._fresh:
            self._seen[frame.sensor] = _Seen(self._fresh, frame.stamp_s, belief.pose_odom_base)
        self._fresh = None


def _readings(payload: Payload) -> tuple[AnyArray, ...]:
    """Return enough of what was measured to know it again: copies, for a source may write into its arrays anew."""
    return tuple(np.array(reading[::_ROWS] if reading.ndim > 1 else reading) for reading in payload.readings)


def _is_same(before: AnyArray, now: AnyArray) -> bool:
    return before.shape == now.shape and before.tobytes() == now.tobytes()
