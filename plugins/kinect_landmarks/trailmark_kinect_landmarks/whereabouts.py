"""Where a camera can be that has lost its pose: landmarks look alike in more than one place, motions lead to one."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.estimates import Belief
from trailmark.geometry import Pose2, Pose3
from trailmark.geometry.rigid import kabsch

__all__ = ["Lead", "Whereabouts", "restart_covariance"]

# A pose so near is where motions lead; farther off by a share of the way and of the turns since, as wheels on a bad
# floor are off. Chosen by reasoning, as all constants here, and looked at on one supermarket (place 1).
_NEAR_M, _NEAR_RAD, _DRIFT = 0.5, 0.6, 0.15
_SIGMAS = 4.0  # of the pose that motions lead on from, beside that
_STOOD_M, _STOOD_RAD = 0.01, 0.01  # motions that moved it by less are as exact as a picture
_RESTARTED_M = 0.1  # an odometry whose way goes back by more began anew; less is a prediction that is taken back
# Of a pose at which landmarks are remembered anew: standard deviations, and by how much they grow without motions.
_RESTART_M, _RESTART_RAD = 0.3, 0.35
_RESTART_M_PER_S, _RESTART_RAD_PER_S = 0.5, 0.5
_LEAST_POINTS = 3  # carry a pose
_ANYWHERE = np.diag([10.0**2, 10.0**2, math.pi**2])


@dataclass(frozen=True, slots=True, eq=False)
class Lead:
    """Where motions lead, and how near that is believed at once.

    Attributes
    ----------
    T_map_base : (4, 4) float64
        The pose; it keeps height and tilt of the last one.
    reach_m, reach_rad : float
        A pose is near within these [m, rad].
    """

    T_map_base: Floats
    reach_m: float
    reach_rad: float

    @property
    def pose(self) -> Pose2:
        """The pose in the plane."""
        return Pose3.from_matrix(self.T_map_base).planar()

    def reaches(self, points_base: Floats, points_map: Floats) -> Bools:
        """Return which points as seen, (N, 3), can be points of the map, (N, 3), from a pose that is near."""
        misses = points_base @ self.T_map_base[:3, :3].T + self.T_map_base[:3, 3] - points_map
        reach_m = self.reach_m + self.reach_rad * np.linalg.norm(points_base, axis=1)
        return np.asarray(np.linalg.norm(misses, axis=1) < reach_m)

    def carries(self, points_base: Floats, points_map: Floats) -> bool:
        """Return whether points as seen, (N, 3), lie as those of the map, (N, 3), from a pose that is near."""
        is_known = np.isfinite(points_base).all(axis=1)
        points_base, points_map = points_base[is_known], points_map[is_known]
        if len(points_base) < _LEAST_POINTS:
            return False
        R, t = kabsch(points_map, points_base, np.ones(len(points_base)))
        return _is_within(Pose2(t[0], t[1], math.atan2(R[1, 0], R[0, 0])), self.pose, self.reach_m, self.reach_rad)


class Whereabouts:
    """The last pose that was known, how well, and where motions have led since.

    Parameters
    ----------
    motion_age_s : float
        Motions that are older than this are interrupted: nothing is known of the way from then on [s].

    Attributes
    ----------
    is_assumed : bool
        Whether the pose was told, or is that at which landmarks were remembered anew, and none has confirmed it yet.
    covariance : (3, 3) float64
        Of the last known pose.
    """

    def __init__(self, motion_age_s: float) -> None:
        self._motion_age_s = motion_age_s
        self._T: Floats | None = None
        self._from = Pose2()
        self._odom: Pose2 | None = None  # None: motions do not tell
        self._travelled_m = self._way_m = self._turned_rad = 0.0
        self.covariance, self.is_assumed = np.zeros((3, 3)), False

    def begin(
        self,
        T_map_base: Floats,
        *,
        covariance: Floats | None = None,
        belief: Belief | None = None,
        is_assumed: bool = False,
    ) -> None:
        """Take a pose that is known now.

        Parameters
        ----------
        T_map_base : (4, 4) float64
            The pose.
        covariance : (3, 3) float64, optional
            Of x, y and heading; default: it is exact.
        belief : Belief, optional
            Says whether motions are told; default: they are not.
        is_assumed : bool
            No landmarks have told it.
        """
        self._T, self.is_assumed = T_map_base, is_assumed
        self._from = Pose3.from_matrix(T_map_base).planar()
        self.covariance = np.zeros((3, 3)) if covariance is None else covariance
        self._odom = belief.pose_odom_base if belief is not None and self.is_told_motion(belief) else None
        self._travelled_m = 0.0 if belief is None else belief.travelled_m
        self._way_m = self._turned_rad = 0.0

    def forget(self) -> None:
        """Know nothing."""
        self._T, self._odom, self.is_assumed = None, None, False

    def follow(self, belief: Belief) -> None:
        """Follow motions since the last picture, and notice where they are interrupted."""
        if self._odom is None or self._T is None:
            return
        step_m = belief.travelled_m - self._travelled_m
        if not self.is_told_motion(belief) or step_m < -_RESTARTED_M:
            self._odom = None
            if self.is_assumed:
                self.forget()
            return
        step = self._odom.between(belief.pose_odom_base)
        self._T = self._T @ Pose3.from_planar(step).matrix()
        self._odom, self._travelled_m = belief.pose_odom_base, belief.travelled_m
        self._way_m += abs(step_m)
        self._turned_rad += abs(math.remainder(step.theta, math.tau))

    def is_told_motion(self, belief: Belief) -> bool:
        """Return whether a belief is moved by motions of late."""
        return belief.motion_age_s < self._motion_age_s

    @property
    def lead(self) -> Lead | None:
        """Where motions lead; None where they do not tell."""
        if self._odom is None or self._T is None:
            return None
        return Lead(self._T, *self._reach())

    @property
    def has_stood(self) -> bool:
        """Whether motions say that it has not moved."""
        return self._odom is not None and self._way_m < _STOOD_M and self._turned_rad < _STOOD_RAD

    def is_near(self, pose: Pose2) -> bool:
        """Return whether a pose is where motions lead, or without any where it is assumed."""
        if self._T is None or (self._odom is None and not self.is_assumed):
            return False
        return _is_within(pose, Pose3.from_matrix(self._T).planar(), *self._reach())

    def is_possible(self, pose: Pose2) -> bool:
        """Return whether it can be a pose, by motions and by how well the pose was known that they lead on from."""
        if self._odom is None or self._T is None:
            return True
        reach_m, reach_rad = self._reach()
        here = Pose3.from_matrix(self._T).planar()
        sigma_m = math.sqrt(max(0.0, float(np.linalg.eigvalsh(self.covariance[:2, :2])[-1])))
        sigma_rad = math.sqrt(max(0.0, float(self.covariance[2, 2])))
        spread_m = sigma_m + sigma_rad * self._from.distance_to(here)
        return _is_within(pose, here, reach_m + _SIGMAS * spread_m, reach_rad + _SIGMAS * sigma_rad)

    def _reach(self) -> tuple[float, float]:
        return _NEAR_M + _DRIFT * self._way_m, _NEAR_RAD + _DRIFT * self._turned_rad


def _is_within(pose: Pose2, of: Pose2, reach_m: float, reach_rad: float) -> bool:
    turned_rad = abs(math.remainder(pose.theta - of.theta, math.tau))
    return of.distance_to(pose) < reach_m and turned_rad < reach_rad


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
