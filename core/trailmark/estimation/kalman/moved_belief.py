"""A belief that was moved against all motion, to where the absolute estimates of one localizer agree.

Fixes that begin late beside where motion has led a sure start, and a start that was wrong, look alike: the fixes
agree among themselves and with motion, by a constant. So a recovery takes their pose for the mean, and the place where
motion had led base stays in the covariance. It counts less the longer they go on to agree, as a lie that has lasted for
a time may last as long again; whatever confirms the new place ends it: another localizer, a pose that is set.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.gate import NOTHING_BESIDE, SHARE_UNDECIDED, threshold
from trailmark.estimation.kalman.innovation import nis_of
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.kalman.state import FilterState, Gaussian, MovedBelief
from trailmark.geometry import Pose2, wrap_angle

__all__ = [
    "LASTS_S",
    "away_from",
    "covariance_of_moved",
    "moved_to",
    "on_another_clock",
    "reason_of_moved",
    "source_of_moved",
    "still_moved",
]

#: The place before is less probable after a time [s]; sooner where no absolute estimate had ever confirmed it.
LASTS_S = 30.0
_UNCONFIRMED_LASTS_S = 10.0
# It is forgotten where it would be 5 standard deviations off.
_FORGOTTEN = 1.0 / 25.0
# With which the new pose is the place before, and an absolute estimate fits it.
_SAME = 0.999


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
        None if the place before is the new one: it was left, and is returned to. Of a belief that was moved before, and
        that is not decided, both places are covered.
    """
    assert state.gaussian is not None
    moved = state.rejections.moved
    here, there = (Pose2(*one.x[:3].tolist()) for one in (state.gaussian, after))
    before = here if moved is None else moved.shift @ here
    covariance = state.gaussian.covariance[:3, :3]
    if moved is not None:
        away = away_from(after, before)
        if float(away @ np.linalg.solve(covariance + after.covariance[:3, :3], away)) < threshold(_SAME, 3):
            return None
        left = away_from(state.gaussian, before)
        covariance = _carried(moved, before) + np.outer(left, left)
    lasts_s = LASTS_S if state.rejections.was_confirmed else _UNCONFIRMED_LASTS_S
    return MovedBelief(source, since_s, state.stamp_s, before @ there.inverse(), before, covariance, lasts_s=lasts_s)


def still_moved(state: FilterState, measurement: Measurement) -> MovedBelief | None:
    """Return what is remembered after an absolute estimate that fits the belief: nothing if that decides for the move.

    Another localizer does, and the same one that has gone on to agree for long.
    """
    moved = state.rejections.moved
    if moved is None or state.gaussian is None:
        return moved
    if measurement.source == moved.source:
        moved = replace(moved, agreed_s=state.stamp_s)
        return moved if _share(moved) > _FORGOTTEN else None
    before = moved.shift @ Pose2(*state.gaussian.x[:3].tolist())
    x = np.concatenate([before.array(), state.gaussian.x[3:]])
    contradicts = nis_of(*measurement.innovation(x), state.gaussian.covariance) > threshold(
        _SAME, len(measurement.root)
    )
    return None if contradicts else moved


def covariance_of_moved(state: FilterState, gaussian: Gaussian) -> Floats:
    """Return what covers the place before the move, (3, 3), beside a belief; zeros if there was none."""
    moved = state.rejections.moved
    if moved is None:
        return NOTHING_BESIDE
    before = moved.shift @ Pose2(*gaussian.x[:3].tolist())
    away = away_from(gaussian, before)
    return np.asarray(_share(moved) * (np.outer(away, away) + _carried(moved, before)))


def source_of_moved(state: FilterState) -> str | None:
    """Return the localizer that a belief was moved for, or against, as long as that is not decided."""
    moved = state.rejections.moved
    return None if moved is None else moved.motion or moved.source


def on_another_clock(moved: MovedBelief, later_s: float) -> MovedBelief:
    """Return the same by a clock that shows so much more [s]."""
    return replace(moved, since_s=moved.since_s + later_s, agreed_s=moved.agreed_s + later_s)


def reason_of_moved(state: FilterState) -> str:
    """Return in words what was done for the sake of a localizer, and that nothing has decided."""
    assert state.rejections.moved is not None
    assert state.gaussian is not None
    here = Pose2(*state.gaussian.x[:3].tolist())
    before = state.rejections.moved.shift @ here
    way_m, turn_rad = math.hypot(before.x - here.x, before.y - here.y), abs(wrap_angle(before.theta - here.theta))
    said = "its absolute estimates" if state.rejections.moved.motion is None else "absolute estimates, not its motion"
    return (
        f"the belief follows {said}, {way_m:.3f} m and {math.degrees(turn_rad):.1f} deg from where"
        " motion led it: nothing has decided who is right, and the belief covers both"
    )


def _carried(moved: MovedBelief, before: Pose2) -> Floats:
    """Return the covariance of the place before the move, (3, 3): its heading was as uncertain on the way since."""
    lever = np.eye(3)
    lever[:2, 2] = moved.pose.y - before.y, before.x - moved.pose.x
    return np.asarray(lever @ moved.covariance @ lever.T)


def away_from(gaussian: Gaussian, place: Pose2) -> Floats:
    """Return by how much a place is off from a belief, (3,), the turn within half a circle [m, m, rad]."""
    away = place.array() - gaussian.x[:3]
    away[2] = wrap_angle(float(away[2]))
    return away


def _share(moved: MovedBelief) -> float:
    """Return the probability of the place before the move, as it is covered now."""
    lasts_s = min(moved.lasts_s, LASTS_S)
    return SHARE_UNDECIDED * lasts_s / max(moved.agreed_s - moved.since_s, lasts_s)
