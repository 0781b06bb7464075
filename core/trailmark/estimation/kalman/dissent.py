"""A belief that absolute estimates contradict, while nothing decides, is as uncertain as it takes to cover both."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.gate import SHARE_UNDECIDED
from trailmark.estimation.kalman.state import FilterState, Gaussian, RejectedMeasurement
from trailmark.estimation.kalman.way_errors import difference_grown
from trailmark.geometry import Pose2

__all__ = ["covering_covariance", "growth_of_difference"]

# Who has said nothing for so long contradicts no more, once any absolute estimate has fitted since [s].
_RECENT_S = 5.0
# More than this share is rejected of a belief that is wrong, of fixes that are, or of a mounting: four in a row, or
# every other one for a while.
_PERSISTENT = 1.0 / 3.0
# So many of the last ones say what parts of poses contradict.
_FEW = 6
# Of a heading of which nothing is known [rad^2].
_NO_HEADING_RAD2 = math.pi**2 / 3.0


def covering_covariance(state: FilterState, gaussian: Gaussian) -> Floats:
    """Return the covariance of the pose, (3, 3), larger by the squares of how far others are off who may be right.

    These are localizers that were rejected more often than accepted of late, unless the absolute estimates of more
    others support the belief, or of as many if it was rarely. Motions that agree do not: a robot may have been carried.
    The filter goes on with its own covariance.

    =======================  ====================  ====================================================================
    what it tells            rejections of late    what is covered
    =======================  ====================  ====================================================================
    whole poses              one                   the last of them, and what motion would be off by since
    whole poses              a third               and the heading by which their way differs from that of the motion
    parts of poses           less                  nothing: each has an error of its own
    parts of poses           a third               what they say, and any heading
    =======================  ====================  ====================================================================

    Parameters
    ----------
    state : FilterState
        With what was rejected.
    gaussian : Gaussian
        The belief, of all hypotheses.
    """
    covariance = gaussian.covariance[:3, :3]
    rivals = state.diagnosis.rivals
    believed = rivals[0].state if rivals else state
    for source, rejected in believed.rejections.measurements.items():
        if rejected and believed.gaussian is not None and _may_be_right(believed, source, rejected[-1]):
            is_persistent = believed.rejections.shares.get(source, 0.0) > _PERSISTENT
            x, pose_odom_base = believed.gaussian.x, believed.odometry.pose_odom_base
            if len(rejected[-1].measurement.root) == 3:
                away = difference_grown(believed.gaussian, pose_odom_base, rejected[-1])
                covariance = covariance + SHARE_UNDECIDED * np.outer(away, away)
                whole = [one for one in rejected if len(one.measurement.root) == 3]
                if is_persistent and not _is_outvoted(believed, source):
                    turned = _turn_between_ways(x, pose_odom_base, whole)
                    covariance = covariance + SHARE_UNDECIDED * np.outer(turned, turned)
            elif is_persistent:
                covariance = covariance + _spread_of_parts(x, pose_odom_base, rejected[-_FEW:])
    return covariance


def growth_of_difference(x: Floats, pose_odom_base: Pose2, rejected: Sequence[RejectedMeasurement]) -> Floats:
    """Return by how much more the last of some whole poses differs from the belief than the first, (3,) [m, m, rad].

    Parameters
    ----------
    x : (3,) or longer float64
        The belief now.
    pose_odom_base : Pose2
        Where motion has carried base.
    rejected : sequence of RejectedMeasurement
        Whole poses of one localizer that the belief contradicted.
    """
    return _difference(x, pose_odom_base, rejected[-1]) - _difference(x, pose_odom_base, rejected[0])


def _may_be_right(state: FilterState, source: str, last: RejectedMeasurement) -> bool:
    if not _contradicts(state, source, last):
        return False
    n_supporting = sum(other != source and _supports(state, other) for other in state.rejections.corroborations)
    if n_supporting == 0:
        return True
    rejected = state.rejections.measurements.items()
    n_contradicting = sum(bool(some) and _contradicts(state, other, some[-1]) for other, some in rejected)
    is_persistent = state.rejections.shares.get(source, 0.0) > _PERSISTENT
    return n_contradicting >= n_supporting if is_persistent else n_contradicting > n_supporting


def _contradicts(state: FilterState, source: str, last: RejectedMeasurement) -> bool:
    """Return whether a localizer has been rejected more often than accepted of late."""
    is_of_late = state.rejections.counts.get(source, 0) or state.rejections.shares.get(source, 0.0) > _PERSISTENT
    is_answered = any(one.stamp_s > last.stamp_s for one in state.rejections.corroborations.values())
    return bool(is_of_late) and not (is_answered and state.stamp_s - last.stamp_s > _RECENT_S)


def _supports(state: FilterState, source: str) -> bool:
    """Return whether the last absolute estimates of a localizer agreed with the belief, and are recent."""
    agreed_s = state.rejections.corroborations[source].stamp_s
    rejected = state.rejections.measurements.get(source)
    return state.stamp_s - agreed_s <= _RECENT_S and not (rejected and rejected[-1].stamp_s > agreed_s)


def _is_outvoted(state: FilterState, source: str) -> bool:
    fault = state.diagnosis.absolute_faults.get(source)
    return fault is not None and fault.is_outvoted


def _difference(x: Floats, pose_odom_base: Pose2, last: RejectedMeasurement) -> Floats:
    """Return by how much a whole pose that was rejected differs from the belief, both carried to now, (3,)."""
    innovation, jacobian = _innovation_of(x, pose_odom_base, last)
    return np.asarray(np.linalg.solve(jacobian, innovation))


def _shift_of(x: Floats, pose_odom_base: Pose2, last: RejectedMeasurement) -> Floats:
    """Return the least shift of the position that explains a part of a pose, (2,)."""
    innovation, jacobian = _innovation_of(x, pose_odom_base, last)
    return np.asarray(np.linalg.pinv(jacobian[:, :2]) @ innovation)


def _innovation_of(x: Floats, pose_odom_base: Pose2, last: RejectedMeasurement) -> tuple[Floats, Floats]:
    then = Pose2(*x[:3].tolist()) @ pose_odom_base.between(last.pose_odom_base)
    innovation, jacobian = last.measurement.innovation(then.array())
    return innovation, jacobian[:, :3]


def _turn_between_ways(x: Floats, pose_odom_base: Pose2, rejected: Sequence[RejectedMeasurement]) -> Floats:
    """Return what the pose changes by, (3,), if the heading is wrong by which the way between rejected poses differs.

    Base has gone on with that heading since the last one. An offset that is constant, as of a place that was matched
    wrongly, says nothing of the heading.
    """
    here = Pose2(*x[:3].tolist())
    first, last = rejected[0], rejected[-1]
    begin, end = (here @ pose_odom_base.between(one.pose_odom_base) for one in (first, last))
    way_m = math.hypot(end.x - begin.x, end.y - begin.y)
    grown = growth_of_difference(x, pose_odom_base, rejected)
    grown_m = math.hypot(grown[0], grown[1])
    turn_rad = 2.0 * math.asin(min(1.0, 0.5 * grown_m / way_m)) if way_m > 0.0 else 0.0
    return turn_rad * np.array([end.y - here.y, here.x - end.x, 1.0])


def _spread_of_parts(x: Floats, pose_odom_base: Pose2, rejected: Sequence[RejectedMeasurement]) -> Floats:
    """Return the covariance that covers what parts of poses say; of the heading they may say anything."""
    shifts = np.array([_shift_of(x, pose_odom_base, one) for one in rejected])
    spread = np.diag([0.0, 0.0, _NO_HEADING_RAD2])
    spread[:2, :2] = 2.0 * SHARE_UNDECIDED * shifts.T @ shifts / len(shifts)  # each tells one direction of two
    return spread
