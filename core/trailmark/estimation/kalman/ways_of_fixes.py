"""The ways between absolute estimates that are not believed: whether they are those of motion again."""

from __future__ import annotations

import numpy as np

from trailmark.estimation.kalman.diagnosis import DetectedFault
from trailmark.estimation.kalman.gate import threshold
from trailmark.estimation.kalman.state import RejectedMeasurement
from trailmark.geometry import Pose2

__all__ = ["ways_agree", "with_heard"]

# A way shorter than so many standard deviations of the absolute estimates tells nothing.
_TELLING = 5.0
# By how much an honest motion errs, as a share of the way and of the turn, and in its heading [rad].
_SHARE, _HEADING_RAD = 0.03, 0.02
_AGREES = 0.99
# Over how long a time ways are compared [s], however often poses come; over how many of them, however seldom; of those
# that come more often than this, some are enough [s].
_KEPT_S, _FEWEST, _EVERY_S = 15.0, 3, 0.5


def with_heard(heard: tuple[RejectedMeasurement, ...], one: RejectedMeasurement) -> tuple[RejectedMeasurement, ...]:
    """Return the whole poses of late of a localizer, after one more, which is the last of them; parts are left out."""
    if len(one.measurement.root) < 3:
        return heard
    if len(heard) > 1 and one.stamp_s - heard[-2].stamp_s < _EVERY_S:
        heard = heard[:-1]
    since_s = one.stamp_s - _KEPT_S
    n_old = sum(before.stamp_s < since_s for before in heard)
    return (*heard[min(n_old, max(len(heard) + 1 - _FEWEST, 0)) :], one)


def ways_agree(fault: DetectedFault) -> bool:
    """Return whether base went by motion as the absolute poses of a localizer say that were kept out of late.

    While base stands nothing tells.

    Parameters
    ----------
    fault : DetectedFault
        With these poses. Where as many as it takes agree with the belief, the way since the first of those counts.
    """
    kept_out = fault.heard
    if fault.n_agreed >= _FEWEST:
        kept_out = tuple(one for one in kept_out if one.stamp_s >= fault.agreed_since_s)
    if len(kept_out) < _FEWEST:
        return False
    first, last = kept_out[0], kept_out[-1]
    way = first.pose_odom_base.between(last.pose_odom_base)
    begun = first.measurement.as_start()
    assert begun is not None
    pose, covariance = begun
    led = Pose2(*pose.tolist()) @ way
    lever = np.eye(3)
    lever[:2, 2] = pose[1] - led.y, led.x - pose[0]
    innovation, jacobian = last.measurement.innovation(led.array())
    root = jacobian[:, :3]
    moved = root @ (led.array() - pose)
    if float(moved @ moved) < _TELLING * _TELLING:
        return False
    way_m = float(np.hypot(way.x, way.y))
    errs = np.diag([_SHARE * way_m, _SHARE * way_m, _HEADING_RAD + _SHARE * abs(way.theta)]) ** 2
    spread = root @ (lever @ (covariance + errs) @ lever.T) @ root.T + np.eye(3)
    return bool(innovation @ np.linalg.solve(spread, innovation) <= threshold(_AGREES, 3))
