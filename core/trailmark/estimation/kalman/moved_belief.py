"""A belief that was moved against all motion, to where the absolute estimates of one localizer agree.

Fixes that begin late beside where motion has led a sure start, and a start that was wrong, look alike: the fixes
agree among themselves and with motion, by a constant. So a recovery takes their pose for the mean, and the place where
motion had led base stays in the covariance. It counts less the longer they go on to agree, as a lie that has lasted for
a time may last as long again; whatever confirms the new place ends it: another localizer, a pose that is set.
"""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.gate import threshold
from trailmark.estimation.kalman.innovation import nis_of
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.kalman.state import FilterState, Gaussian, MovedBelief
from trailmark.geometry import Pose2, wrap_angle

__all__ = ["covariance_of_moved", "moved_to", "reason_of_moved", "source_of_moved", "still_moved"]

# Probability of the place before; whoever is right is within 2.3 standard deviations. It is less after a time [s], and
# forgotten where it would be 5 standard deviations off.
_SHARE, _LASTS_S, _FORGOTTEN = 1.0 / 5.0, 30.0, 1.0 / 25.0
# With which the new pose is the place before, and an absolute estimate fits it.
_SAME = 0.999
_NOTHING: Floats = np.zeros((3, 3))


def moved_to(state: FilterState, source: str, since_s: float, after: Gaussian) -> MovedBelief | None:
    """Return what is to be remembered of a belief that is given up for another.

    Parameters
    ----------
    state : FilterState
        Before that, with a known pose.
    source : str
        For whose absolute estimates.
    since_s : float
        When they began to contradict [s].
    after : Gaussian
        The other belief.

    Returns
    -------
    MovedBelief or None
        None if the place before is the new one: it was left, and is returned to.
    """
    assert state.gaussian is not None
    moved = state.rejections.moved
    here, there = (Pose2(*one.x[:3].tolist()) for one in (state.gaussian, after))
    before = here if moved is None else moved.shift @ here
    covariance = state.gaussian.covariance[:3, :3] if moved is None else _carried(moved, before)
    away = before.array() - after.x[:3]
    away[2] = wrap_angle(float(away[2]))
    spread = state.gaussian.covariance[:3, :3] + after.covariance[:3, :3]
    if moved is not None and float(away @ np.linalg.solve(spread, away)) < threshold(_SAME, 3):
        return None
    since_s = since_s if moved is None else moved.since_s
    return MovedBelief(source, since_s, before @ there.inverse(), before, covariance)


def still_moved(state: FilterState, measurement: Measurement) -> MovedBelief | None:
    """Return what is remembered after an absolute estimate that fits the belief: nothing if it confirms the move."""
    moved = state.rejections.moved
    if moved is None or state.gaussian is None or measurement.source == moved.source:
        return moved
    before = moved.shift @ Pose2(*state.gaussian.x[:3].tolist())
    x = np.concatenate([before.array(), state.gaussian.x[3:]])
    contradicts = nis_of(*measurement.innovation(x), state.gaussian.covariance) > threshold(
        _SAME, len(measurement.root)
    )
    return None if contradicts else moved


def covariance_of_moved(state: FilterState, gaussian: Gaussian) -> Floats:
    """Return what covers the place before the move, (3, 3), beside a belief; zeros if there was none."""
    share, moved = _share(state), state.rejections.moved
    if moved is None or share == 0.0:
        return _NOTHING
    before = moved.shift @ Pose2(*gaussian.x[:3].tolist())
    away = before.array() - gaussian.x[:3]
    away[2] = wrap_angle(float(away[2]))
    return np.asarray(share * (np.outer(away, away) + _carried(moved, before)))


def source_of_moved(state: FilterState) -> str | None:
    """Return the localizer that a belief was moved for, as long as that is not decided."""
    moved = state.rejections.moved
    return None if moved is None or _share(state) == 0.0 else moved.source


def reason_of_moved(state: FilterState) -> str:
    """Return in words what was done for the sake of a localizer, and that nothing has decided."""
    assert state.rejections.moved is not None
    assert state.gaussian is not None
    here = Pose2(*state.gaussian.x[:3].tolist())
    before = state.rejections.moved.shift @ here
    way_m, turn_rad = math.hypot(before.x - here.x, before.y - here.y), abs(wrap_angle(before.theta - here.theta))
    return (
        f"the belief follows its absolute estimates, {way_m:.3f} m and {math.degrees(turn_rad):.1f} deg from where"
        " motion led it: nothing has decided who is right, and the belief covers both"
    )


def _carried(moved: MovedBelief, before: Pose2) -> Floats:
    """Return the covariance of the place before the move, (3, 3): its heading was as uncertain on the way since."""
    lever = np.eye(3)
    lever[:2, 2] = moved.pose.y - before.y, before.x - moved.pose.x
    return np.asarray(lever @ moved.covariance @ lever.T)


def _share(state: FilterState) -> float:
    """Return the probability of the place before the move, as it is covered now; 0 if there was none."""
    moved = state.rejections.moved
    agreed = None if moved is None else state.rejections.corroborations.get(moved.source)
    if moved is None or agreed is None:
        return 0.0
    share = _SHARE * min(1.0, _LASTS_S / max(agreed.stamp_s - moved.since_s, _LASTS_S))
    return share if share > _FORGOTTEN else 0.0
