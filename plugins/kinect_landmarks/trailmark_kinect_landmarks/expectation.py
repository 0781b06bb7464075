"""The expected movement, by which the paper separates moving things from the robot's own movement."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from trailmark.arrays import Floats
from trailmark_kinect_landmarks.systematic import Rates

__all__ = ["LEARNS_EVERY_S", "Expectation", "Expected"]

#: What is carried off at a walk moves by little between two pictures of a fast camera, and leads the newest poses
#: along; in this time it moves by more than it is measured to. So nothing is learned in less, however fast they come.
LEARNS_EVERY_S = 0.095

_LEARNS = 0.15  # what the newest miss counts, the first ones more
_SLACK = 2.0  # sigmas of the misses of late that an expectation is worth
_FLOOR_M, _FLOOR_RAD = 0.003, math.radians(0.1)
_UNKNOWN_M, _UNKNOWN_RAD = 0.1, math.radians(5.0)
# A motion is expected from poses that are so old at least.
_BEFORE_S = LEARNS_EVERY_S
_KEPT = 64
# A camera goes on so evenly that what it did before tells where it is to this: on wheels, not in a hand.
_EVEN_M, _EVEN_RAD = 0.02, math.radians(1.0)
# That is known from so many misses on, of the last so many; and a standard deviation over the median.
_USUAL_FROM, _USUAL_OF, _SIGMA_OVER_MEDIAN = 5, 30, 1.4826
# So many standard deviations off, an even movement is a surprise.
_SURPRISING = 4.0
# Pictures come as evenly as this, and their motions are taken as they are.
_ALIKE = 0.05


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


class _Misses:
    """By how much expectations were off of late: variances along the axes of the robot, and of the turn."""

    def __init__(self) -> None:
        self.variance_m2, self.variance_rad2 = np.full(3, _UNKNOWN_M**2), _UNKNOWN_RAD**2
        self._n = 0

    def learn(self, stamp_s: float, miss: Floats) -> None:
        """Take the last miss, (4,): along three axes, and the turn."""
        self._n += 1
        gain = max(_LEARNS, 1.0 / self._n)
        self.variance_m2 += gain * (miss[:3] ** 2 - self.variance_m2)
        self.variance_rad2 += gain * (float(miss[3]) ** 2 - self.variance_rad2)


class _UsualMisses(_Misses):
    """The same of expectations from before, by the median of some seconds: what begins to move teaches nothing."""

    def __init__(self) -> None:
        super().__init__()
        self._last: deque[Floats] = deque(maxlen=_USUAL_OF)
        self._learned_s = -math.inf

    def learn(self, stamp_s: float, miss: Floats) -> None:
        """Take the last miss, if the one before is old enough."""
        if 0.0 <= stamp_s - self._learned_s < LEARNS_EVERY_S:
            return
        self._learned_s = stamp_s
        self._last.append(np.abs(miss))
        usual = _SIGMA_OVER_MEDIAN * np.median(self._last, axis=0)
        self.variance_m2, self.variance_rad2 = usual[:3] ** 2, float(usual[3]) ** 2

    @property
    def are_small(self) -> bool:
        """Whether the camera goes on evenly."""
        is_known = len(self._last) >= _USUAL_FROM
        return is_known and bool(self.variance_m2.max() < _EVEN_M**2 and self.variance_rad2 < _EVEN_RAD**2)


def _miss_of(expected: Floats, T_map_base: Floats) -> Floats:
    """Return by how much a pose was missed, (4,): along the axes of the robot, and the turn about any [m, rad]."""
    miss = np.linalg.inv(expected) @ T_map_base
    cosine = (np.trace(miss[:3, :3]) - 1.0) / 2.0
    return np.append(miss[:3, 3], math.acos(min(1.0, max(-1.0, float(cosine)))))


class Expectation:
    """Carries the pose on with the last velocity, and knows how far off that has been of late.

    A robot on wheels moves evenly: what it sees against its expectation moves by itself. It is expected from poses that
    are some time old, which what begins to move has not led along. A camera in a hand does not, and is expected to be
    anywhere near its last poses.
    """

    def __init__(self) -> None:
        self._poses: list[tuple[float, Floats]] = []  # of the last quarter second, two at least: stamps and T_map_base
        self._misses, self._misses_from_before = _Misses(), _UsualMisses()

    @property
    def last(self) -> tuple[float, Floats] | None:
        """Stamp and pose of the last answer; the stamp is -inf for a known start; None: lost."""
        return self._poses[-1] if self._poses else None

    def begin(self, stamp_s: float, T_map_base: Floats) -> None:
        """Begin anew at a pose."""
        self._poses = [(stamp_s, T_map_base)]
        self._misses, self._misses_from_before = _Misses(), _UsualMisses()

    def forget(self) -> None:
        """Expect nothing."""
        self._poses = []

    def took(self, stamp_s: float, T_map_base: Floats) -> None:
        """Take a pose that was found, and learn how good the expectation was."""
        if len(self._poses) >= 2:
            expected, from_before = self.pose(stamp_s), self._from_before(stamp_s)
            assert expected is not None
            assert from_before is not None
            self._misses.learn(stamp_s, _miss_of(expected, T_map_base))
            self._misses_from_before.learn(stamp_s, _miss_of(from_before, T_map_base))
        recent = [one for one in self._poses[-_KEPT:] if stamp_s - one[0] <= 3.5 * _BEFORE_S]
        self._poses = [*(recent or self._poses[-1:]), (stamp_s, T_map_base)]

    def pose(self, stamp_s: float) -> Floats | None:
        """Return T_map_base expected at a stamp by the last two poses; None without a pose to begin from."""
        if not self._poses:
            return None
        if len(self._poses) < 2:
            return self._poses[-1][1]
        return _carried_on(self._poses[-2], self._poses[-1], stamp_s)

    def _from_before(self, stamp_s: float) -> Floats | None:
        """Return T_map_base expected at a stamp by older poses; by the last two where pictures are rare.

        Of what pairs of them say it is the one that is nearest to the others: where one of three pictures was led
        astray, that goes on in every third, and the other two contradict it.
        """
        found: list[Floats] = []
        for last in range(self._newest_before(len(self._poses) - 1, stamp_s), 0, -1):
            before = self._newest_before(last - 1, self._poses[last][0])
            if before < 0 and found:
                break
            found.append(_carried_on(self._poses[max(before, 0)], self._poses[last], stamp_s))
        if not found:
            return self.pose(stamp_s)
        places = np.array([T[:3, 3] for T in found])
        apart_m = np.linalg.norm(places[:, None] - places, axis=2).sum(axis=1)
        return found[int(apart_m.argmin())]

    def _newest_before(self, index: int, stamp_s: float) -> int:
        """Return the index of the newest pose, from one on, that is old enough at a stamp; -1 without any."""
        while index >= 0 and stamp_s - self._poses[index][0] < _BEFORE_S:
            index -= 1
        return index

    def is_surprised(self, stamp_s: float, T_map_base: Floats) -> bool:
        """Return whether a camera that goes on evenly would be farther than usual from where it is expected."""
        from_before = self._from_before(stamp_s)
        if from_before is None or not self._misses_from_before.are_small:
            return False
        usual = self._misses_from_before
        miss_m = np.abs(_miss_of(from_before, T_map_base)[:3])
        return bool((miss_m > _SURPRISING * np.maximum(np.sqrt(usual.variance_m2), _FLOOR_M / _SLACK)).any())

    def rates(self) -> Rates | None:
        """Return how fast the camera has moved between the last two poses; None with fewer."""
        if len(self._poses) < 2:
            return None
        (before_s, before), (last_s, last) = self._poses[-2:]
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
        is_even = self._misses_from_before.are_small
        misses = self._misses_from_before if is_even else self._misses
        T = self._from_before(stamp_s) if is_even else self.pose(stamp_s)
        if T is None:
            return None
        last_s = self._poses[-1][0]
        is_regular = len(self._poses) >= 2 and stamp_s - last_s < 2.0 * (last_s - self._poses[-2][0])
        sigma_m, sigma_rad = np.full(3, _SLACK * _UNKNOWN_M), _SLACK * _UNKNOWN_RAD
        if is_regular:
            sigma_m, sigma_rad = _SLACK * np.sqrt(misses.variance_m2), _SLACK * math.sqrt(misses.variance_rad2)
        D = n_dimensions
        return Expected(T[:D, :D], T[:D, 3], np.maximum(sigma_m, _FLOOR_M)[:D], max(sigma_rad, _FLOOR_RAD))


def _carried_on(before: tuple[float, Floats], last: tuple[float, Floats], stamp_s: float) -> Floats:
    """Return the pose at a stamp with the velocity between two poses; the last one where that is too far away."""
    share = (stamp_s - last[0]) / (last[0] - before[0])
    if not 0.5 < share < 2.0:
        return last[1]
    step = np.linalg.inv(before[1]) @ last[1]
    return np.asarray(last[1] @ (step if abs(share - 1.0) < _ALIKE else _scaled(step, share)), np.float64)


def _scaled(step: Floats, share: float) -> Floats:
    """Return a share of a small motion, (4, 4)."""
    scaled = np.eye(4)
    scaled[:3, :3] = cv2.Rodrigues(share * cv2.Rodrigues(step[:3, :3])[0])[0]
    scaled[:3, 3] = share * step[:3, 3]
    return scaled
