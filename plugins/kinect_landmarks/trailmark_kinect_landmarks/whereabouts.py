"""Where a camera can be that has lost its pose: landmarks look alike in more than one place, motions lead to one."""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Belief
from trailmark.geometry import Pose2

__all__ = ["NEAR_M", "NEAR_RAD", "Whereabouts", "restart_covariance"]

# Chosen by reasoning: so near a pose is where motions lead, and farther by a share of the way and of the turns since,
# as wheels on a bad floor are off.
NEAR_M, NEAR_RAD, _DRIFT = 0.5, 0.6, 0.15
_SIGMAS = 4.0  # of the pose that motions lead on from, beside that
_STOOD_M, _STOOD_RAD = 0.01, 0.01  # motions that moved it by less are as exact as a picture
# Of a pose at which landmarks are remembered anew: standard deviations, and by how much they grow without motions.
_RESTART_M, _RESTART_RAD = 0.3, 0.35
_RESTART_M_PER_S, _RESTART_RAD_PER_S = 0.5, 0.5
_ANYWHERE = np.diag([10.0**2, 10.0**2, math.pi**2])


class Whereabouts:
    """The last pose that was known, how well, and where motions have led since.

    Parameters
    ----------
    motion_age_s : float
        Motions that are older than this are interrupted: nothing is known of the way from then on [s].

    Attributes
    ----------
    is_assumed : bool
        Whether the pose was told, or taken from the belief, and no landmarks have confirmed it yet.
    """

    def __init__(self, motion_age_s: float) -> None:
        self._motion_age_s = motion_age_s
        self._pose: Pose2 | None = None
        self._covariance = np.zeros((3, 3))
        self._odom: Pose2 | None = None  # None: motions do not tell
        self._travelled_m = self._way_m = self._turned_rad = 0.0
        self.is_assumed = False

    def begin(self, pose: Pose2, covariance: Floats | None, belief: Belief | None, *, is_assumed: bool = False) -> None:
        """Take a pose that is known now, with its covariance (None: exact), and the belief about motion if there is."""
        self._pose, self.is_assumed = pose, is_assumed
        self._covariance = np.zeros((3, 3)) if covariance is None else covariance
        self._odom = belief.pose_odom_base if belief is not None and self.is_told_motion(belief) else None
        self._travelled_m = 0.0 if belief is None else belief.travelled_m
        self._way_m = self._turned_rad = 0.0

    def follow(self, belief: Belief) -> None:
        """Follow motions since the last picture, and notice where they are interrupted."""
        step_m = belief.travelled_m - self._travelled_m
        if self._odom is None or self._pose is None or not self.is_told_motion(belief) or step_m < 0.0:
            self._odom = None
            return
        step = self._odom.between(belief.pose_odom_base)
        self._pose = self._pose @ step
        self._odom, self._travelled_m = belief.pose_odom_base, belief.travelled_m
        self._way_m += step_m
        self._turned_rad += abs(math.remainder(step.theta, math.tau))

    def is_told_motion(self, belief: Belief) -> bool:
        """Return whether a belief is moved by motions of late."""
        return belief.motion_age_s < self._motion_age_s

    @property
    def led(self) -> Pose2 | None:
        """Where motions lead; None where they do not tell."""
        return self._pose if self._odom is not None else None

    @property
    def has_stood(self) -> bool:
        """Whether motions say that it has not moved."""
        return self._odom is not None and self._way_m < _STOOD_M and self._turned_rad < _STOOD_RAD

    def is_near(self, pose: Pose2) -> bool:
        """Return whether a pose is where motions lead, or without any where it is assumed."""
        if self._pose is None or (self._odom is None and not self.is_assumed):
            return False
        return self._is_within(pose, NEAR_M, NEAR_RAD)

    def is_possible(self, pose: Pose2) -> bool:
        """Return whether it can be a pose, by motions and by how well the pose was known that they lead on from."""
        if self.led is None:
            return True
        spread_m = _SIGMAS * math.sqrt(max(0.0, float(np.linalg.eigvalsh(self._covariance[:2, :2])[-1])))
        return self._is_within(pose, NEAR_M + spread_m, NEAR_RAD + _SIGMAS * math.sqrt(self._covariance[2, 2]))

    def restart_covariance(self, gap_s: float) -> Floats:
        """Return the covariance of the last known pose after a time without motions [s], (3, 3)."""
        return restart_covariance(gap_s, self._covariance)

    def _is_within(self, pose: Pose2, reach_m: float, reach_rad: float) -> bool:
        assert self._pose is not None
        turned_rad = abs(math.remainder(pose.theta - self._pose.theta, math.tau))
        is_near = self._pose.distance_to(pose) < reach_m + _DRIFT * self._way_m
        return is_near and turned_rad < reach_rad + _DRIFT * self._turned_rad


def restart_covariance(gap_s: float, known: Floats | None) -> Floats:
    """Return the covariance of a pose at which landmarks are remembered anew.

    Parameters
    ----------
    gap_s : float
        Time over which nothing says how the camera moved; 0 where motions do [s].
    known : (3, 3) float64 or None
        Covariance of the pose before; None where that is not estimated.

    Returns
    -------
    (3, 3) float64
        Of x, y and heading [m, m, rad].
    """
    spread_m = _RESTART_M + _RESTART_M_PER_S * gap_s
    spread_rad = min(_RESTART_RAD + _RESTART_RAD_PER_S * gap_s, math.pi)
    covariance = np.diag([spread_m**2, spread_m**2, spread_rad**2])
    if known is None:
        return covariance
    return np.asarray(covariance + (known if np.isfinite(known).all() else _ANYWHERE))
