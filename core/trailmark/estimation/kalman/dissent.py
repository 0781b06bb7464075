"""A belief that absolute estimates contradict, while nothing decides, is as uncertain as it takes to cover both."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.state import FilterState, Gaussian, RejectedMeasurement
from trailmark.geometry import Pose2

__all__ = ["covering_covariance"]

# Probability of those that contradict, if nothing is known: at 1 to 4 what they say is 3.2 standard deviations off, in
# the mean of two directions, and what is believed is at its centre.
_SHARE = 1.0 / 5.0
# Who has said nothing for so long contradicts no more [s].
_RECENT_S = 5.0


def covering_covariance(state: FilterState, gaussian: Gaussian) -> Floats:
    """Return the covariance of the pose, (3, 3), larger by the squares of how far others are off who may be right.

    These are localizers that tell whole poses and were rejected more often than accepted of late, unless other absolute
    estimates support the belief. Motions that agree do not: a robot may have been carried. The filter goes on with
    its own covariance.
    """
    covariance = gaussian.covariance[:3, :3]
    rivals = state.consistency.rivals
    believed = rivals[0].state if rivals else state
    for source, rejected in believed.rejections.measurements.items():
        if rejected and believed.gaussian is not None and _may_be_right(believed, source, rejected[-1]):
            away = _difference(believed.gaussian.x, believed.odometry.pose_odom_base, rejected[-1])
            covariance = covariance + _SHARE * np.outer(away, away)
    return covariance


def _may_be_right(state: FilterState, source: str, last: RejectedMeasurement) -> bool:
    if not state.rejections.counts.get(source, 0) or state.stamp_s - last.stamp_s > _RECENT_S:
        return False
    if len(last.measurement.root) < 3:
        return False
    others = state.rejections.corroborations.items()
    return not any(other != source and state.stamp_s - fix.stamp_s <= _RECENT_S for other, fix in others)


def _difference(x: Floats, pose_odom_base: Pose2, last: RejectedMeasurement) -> Floats:
    """Return by how much a whole pose that was rejected differs from the belief, both carried to now, (3,)."""
    then = Pose2(*x[:3].tolist()) @ pose_odom_base.between(last.pose_odom_base)
    innovation, jacobian = last.measurement.innovation(then.array())
    return np.asarray(np.linalg.solve(jacobian[:, :3], innovation))
