"""The expected movement, by which the paper separates moving things from the robot's own movement."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from trailmark.arrays import Floats
from trailmark_kinect_landmarks.systematic import Rates

__all__ = ["Expectation", "Expected"]

_LEARNS = 0.15  # what the newest miss counts, the first ones more
_SLACK = 2.0  # sigmas of the misses of late that an expectation is worth
_FLOOR_M, _FLOOR_RAD = 0.003, math.radians(0.1)
_UNKNOWN_M, _UNKNOWN_RAD = 0.1, math.radians(5.0)


@dataclass(frozen=True, eq=False)
class Expected:
    """The motion that is expected, with its covariance.

    Attributes
    ----------
    R, t : (D, D), (D,) float64
        ``points_a = R points_b + t``.
    sigma_m : (D,) float64
        Standard deviations along the axes of b, the robot's: sideways it is surer than ahead [m].
    sigma_rad : float
        ... and of the turn about any axis [rad].
    """

    R: Floats
    t: Floats
    sigma_m: Floats
    sigma_rad: float

    @cached_property
    def information(self) -> Floats:
        """Inverse covariance of translation and rotation, (3, 3) or (6, 6)."""
        D = len(self.t)
        n = 3 if D == 2 else 6
        information = np.eye(n) * self.sigma_rad**-2
        information[:D, :D] = self.R @ np.diag(np.asarray(self.sigma_m) ** -2.0) @ self.R.T
        return information

    def begun_from(self, covariance: Floats) -> Expected:
        """Return the same motion, no surer than the planar pose that it begins from.

        Parameters
        ----------
        covariance : (3, 3) float64
            Of x, y and heading of the last pose [m, m, rad].
        """
        spread_m = math.sqrt(max(0.0, float(np.linalg.eigvalsh(covariance[:2, :2])[-1])))
        sigma_rad = math.hypot(self.sigma_rad, math.sqrt(float(covariance[2, 2])))
        return replace(self, sigma_m=np.hypot(self.sigma_m, spread_m), sigma_rad=sigma_rad)

    def seen_from(self, R: Floats, t: Floats) -> Floats:
        """Return how far it is from another motion: translation, and rotation on the left, (3,) or (6,)."""
        turn = self.R @ R.T
        if len(t) == 2:
            return np.array([*(self.t - t), math.atan2(turn[1, 0], turn[0, 0])])
        axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2.0
        sine = float(np.linalg.norm(axis))
        angle = math.atan2(sine, (float(np.trace(turn)) - 1.0) / 2.0)
        return np.concatenate([self.t - t, axis * (angle / sine if sine > 1e-9 else 1.0)])


class Expectation:
    """Carries the pose on with the last velocity, and knows how far off that has been of late.

    A robot on wheels moves evenly: what it sees against its expectation moves by itself. A camera in a hand does not,
    and is expected to be anywhere near.
    """

    def __init__(self) -> None:
        self._poses: list[tuple[float, Floats]] = []  # the last two: stamps and T_map_base
        self._variance_m2, self._variance_rad2 = np.full(3, _UNKNOWN_M**2), _UNKNOWN_RAD**2
        self._n_learned = 0

    @property
    def last(self) -> tuple[float, Floats] | None:
        """Stamp and pose of the last answer; the stamp is -inf for a known start; None: lost."""
        return self._poses[-1] if self._poses else None

    def begin(self, stamp_s: float, T_map_base: Floats) -> None:
        """Begin anew at a pose."""
        self._poses = [(stamp_s, T_map_base)]
        self._variance_m2, self._variance_rad2 = np.full(3, _UNKNOWN_M**2), _UNKNOWN_RAD**2
        self._n_learned = 0

    def forget(self) -> None:
        """Expect nothing."""
        self._poses = []

    def took(self, stamp_s: float, T_map_base: Floats) -> None:
        """Take a pose that was found, and learn how good the expectation was."""
        expected = self.pose(stamp_s)
        if expected is not None and len(self._poses) == 2:
            miss = np.linalg.inv(expected) @ T_map_base
            cosine = (np.trace(miss[:3, :3]) - 1.0) / 2.0
            turn_rad = math.acos(min(1.0, max(-1.0, float(cosine))))
            self._n_learned += 1
            gain = max(_LEARNS, 1.0 / self._n_learned)
            self._variance_m2 += gain * (miss[:3, 3] ** 2 - self._variance_m2)
            self._variance_rad2 += gain * (turn_rad**2 - self._variance_rad2)
        self._poses = [*self._poses[-1:], (stamp_s, T_map_base)]

    def pose(self, stamp_s: float) -> Floats | None:
        """Return T_map_base expected at a stamp; None without a pose to begin from."""
        if not self._poses:
            return None
        last_s, last = self._poses[-1]
        if len(self._poses) < 2:
            return last
        before_s, before = self._poses[0]
        share = (stamp_s - last_s) / (last_s - before_s)
        return last @ (np.linalg.inv(before) @ last) if 0.5 < share < 2.0 else last

    def rates(self) -> Rates | None:
        """Return how fast the camera has moved between the last two poses; None with fewer."""
        if len(self._poses) < 2:
            return None
        (before_s, before), (last_s, last) = self._poses
        dt_s = last_s - before_s
        if not math.isfinite(dt_s) or dt_s <= 0.0:
            return None
        turned = before[:3, :3].T @ last[:3, :3]
        spin_rad = math.acos(min(1.0, max(-1.0, (float(np.trace(turned)) - 1.0) / 2.0)))
        heading_rad = math.atan2(last[1, 0], last[0, 0]) - math.atan2(before[1, 0], before[0, 0])
        turn_rad = math.remainder(heading_rad, math.tau)
        return Rates((last[:2, 3] - before[:2, 3]) / dt_s, turn_rad / dt_s, spin_rad / dt_s)

    def motion(self, stamp_s: float, n_dimensions: int) -> Expected | None:
        """Return the expected motion at a stamp, in the plane (2) or in space (3), with its covariance."""
        T = self.pose(stamp_s)
        if T is None:
            return None
        last_s = self._poses[-1][0]
        is_regular = len(self._poses) == 2 and stamp_s - last_s < 2.0 * (last_s - self._poses[0][0])
        sigma_m, sigma_rad = np.full(3, _SLACK * _UNKNOWN_M), _SLACK * _UNKNOWN_RAD
        if is_regular:
            sigma_m, sigma_rad = _SLACK * np.sqrt(self._variance_m2), _SLACK * math.sqrt(self._variance_rad2)
        D = n_dimensions
        return Expected(T[:D, :D], T[:D, 3], np.maximum(sigma_m, _FLOOR_M)[:D], max(sigma_rad, _FLOOR_RAD))
