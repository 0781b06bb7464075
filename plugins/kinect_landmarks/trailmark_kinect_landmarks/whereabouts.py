"""Where a camera can be that has lost its pose: landmarks look alike in more than one place, motions carry it to one.

Without motions of others nothing is known of a gap but that no robot is fast.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Belief
from trailmark.geometry import Pose2

__all__ = ["Whereabouts", "is_in_reach", "restart_covariance"]

#: A pose is in reach of another so near, and for each metre that was driven since by so much more [m].
_REACH_M, _REACH_RAD, _DRIFT = 0.5, 0.6, 0.15
#: Of a pose at which landmarks are remembered anew: standard deviations, and by how much they grow without motions.
_RESTART_M, _RESTART_RAD = 0.3, 0.35
_RESTART_M_PER_S, _RESTART_RAD_PER_S = 0.5, 0.5


@dataclass(frozen=True, slots=True)
class _Left:
    """A pose that was known, and what the belief said of motion then."""

    pose: Pose2
    pose_odom_base: Pose2
    travelled_m: float


class Whereabouts:
    """The last pose that was found, or begun at, and where motions have carried it since.

    Parameters
    ----------
    motion_age_s : float
        Motions that are older than this are interrupted: nothing is known of the way from then on [s].
    """

    def __init__(self, motion_age_s: float) -> None:
        self._motion_age_s = motion_age_s
        self._left: _Left | None = None

    def begin(self, pose: Pose2, belief: Belief) -> None:
        """Take a pose that is known now."""
        self._left = None
        if self._moves(belief):
            self._left = _Left(pose, belief.pose_odom_base, belief.travelled_m)

    def follow(self, belief: Belief) -> None:
        """Notice motions that are interrupted; to be called with every picture."""
        if not self._moves(belief):
            self._left = None

    def carried(self, belief: Belief) -> Pose2 | None:
        """Return where motions have carried the last known pose; None where they do not tell."""
        if self._left is None:
            return None
        return self._left.pose @ self._left.pose_odom_base.between(belief.pose_odom_base)

    def way_m(self, belief: Belief) -> float:
        """Return the way since the last known pose; infinite where nothing tells [m]."""
        return math.inf if self._left is None else belief.travelled_m - self._left.travelled_m

    def _moves(self, belief: Belief) -> bool:
        return belief.motion_age_s < self._motion_age_s


def is_in_reach(pose: Pose2, of: Pose2, way_m: float = 0.0) -> bool:
    """Return whether a pose can be another after a way [m], as exact as wheels on a bad floor."""
    turned_rad = abs(math.remainder(pose.theta - of.theta, math.tau))
    return of.distance_to(pose) < _REACH_M + _DRIFT * way_m and turned_rad < _REACH_RAD


def restart_covariance(gap_s: float, believed: Floats | None) -> Floats:
    """Return the covariance of a pose at which landmarks are remembered anew, (3, 3).

    Parameters
    ----------
    gap_s : float
        Time over which nothing says how the camera moved; 0 where motions do [s].
    believed : (3, 3) float64 or None
        Covariance of the belief that the pose is taken from.
    """
    spread_m = _RESTART_M + _RESTART_M_PER_S * gap_s
    spread_rad = min(_RESTART_RAD + _RESTART_RAD_PER_S * gap_s, math.pi)
    covariance = np.diag([spread_m**2, spread_m**2, spread_rad**2])
    return covariance if believed is None else covariance + believed
