"""The ways between absolute estimates that are not believed: whether they are those of motion again."""

from __future__ import annotations

import numpy as np

from trailmark.estimation.kalman.forgiveness import AGREED
from trailmark.estimation.kalman.gate import threshold
from trailmark.estimation.kalman.state import FilterState
from trailmark.geometry import Pose2

__all__ = ["ways_agree"]

# A way shorter than so many standard deviations of the absolute estimates tells nothing.
_TELLING = 5.0
# By how much an honest motion errs, as a share of the way and of the turn, and in its heading [rad].
_SHARE, _HEADING_RAD = 0.03, 0.02
_AGREES = 0.99


def ways_agree(state: FilterState, source: str, n_agreed: int) -> bool:
    """Return whether base went by motion as the absolute poses of a localizer say that were kept out of late.

    Parameters
    ----------
    state : FilterState
        With what was kept out.
    source : str
        The localizer.
    n_agreed : int
        So many of the last of them agree with the belief; with too few the way since the oldest counts.
    """
    kept_out = [one for one in state.rejections.measurements.get(source, ()) if len(one.measurement.root) == 3]
    if n_agreed >= AGREED:
        kept_out = kept_out[-n_agreed:]
    if len(kept_out) < AGREED:
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
