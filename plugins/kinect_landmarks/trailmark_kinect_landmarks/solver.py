"""The pose that landmarks carry: of all that may vote, or of the few that tell most."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats, Indices
from trailmark_kinect_landmarks.alignment import (
    AlignmentLimits,
    CloudAlignment,
    Refusal,
    align,
    jacobian,
    planar_covariance,
    reachable,
)
from trailmark_kinect_landmarks.config import FEW, KinectLandmarksConfig
from trailmark_kinect_landmarks.expectation import Expected
from trailmark_kinect_landmarks.landmarks import TrackedLandmarks
from trailmark_kinect_landmarks.level import LevelWatch
from trailmark_kinect_landmarks.memory import LandmarkMemory
from trailmark_kinect_landmarks.systematic import TravelledWay

__all__ = ["PoseSolver", "Solved"]


_ENOUGH = 12  # landmarks that agree, so that those on trial need not be asked
_SUPPORT = 0.7  # of the candidates that must agree with the pose of the few
_CLOSELY = 4.0  # squared sigmas within which a candidate may be one of the few: each of three has its way
_GATE = 16.3  # chi-square of three numbers, 99.9 %
_MODEL_SIGMA_M = 0.004  # what calibration and rounding of depth add to every point


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """A pose.

    Attributes
    ----------
    T_map_base : (4, 4) float64
        In space; with ``solve: plane`` level and at height 0.
    covariance : (3, 3) float64
        Of the planar pose: of the measurements, and of the poses at which the landmarks were remembered.
    agreeing : TrackedLandmarks
        Landmarks that agree with the pose.
    residual_m : float
        Root mean square distance [m].
    drift : TravelledWay
        What systematic errors have grown on; they are not in the covariance.
    """

    T_map_base: Floats
    covariance: Floats
    agreeing: TrackedLandmarks
    residual_m: float
    drift: TravelledWay


class PoseSolver:
    """Solves for the pose at which landmarks stand where they are remembered.

    Parameters
    ----------
    config : KinectLandmarksConfig
        How.
    memory : LandmarkMemory
        Where they stand.
    limits : AlignmentLimits
        When landmarks carry a pose.
    rng : Generator
        Draws minimal sets.
    """

    def __init__(
        self, config: KinectLandmarksConfig, memory: LandmarkMemory, limits: AlignmentLimits, rng: np.random.Generator
    ) -> None:
        self._config, self._memory, self._limits, self._rng = config, memory, limits, rng
        self._level = LevelWatch(config.solve == "plane", notices=config.notice_tilt)
        self._spread: Floats | None = None  # covariance of the last pose of the few

    @property
    def n_dimensions(self) -> int:
        """2 where poses are solved in the plane, 3 in space."""
        return self._level.n_dimensions

    @property
    def n_needed(self) -> int:
        """Landmarks that must agree: in space at least three."""
        return max(self._limits.min_landmarks, self.n_dimensions)

    def notices_tilt(self, stamp_s: float, again: TrackedLandmarks) -> bool:
        """Return whether landmarks show for the first time that the camera tilts; then all is solved in space."""
        able = again.pick(np.asarray(~self._memory.is_moved[again.rows]))
        return self._level.notices_tilt(stamp_s, able.seen.points_base, self._memory.points[able.rows, 2])

    def solve(self, again: TrackedLandmarks, expected: Expected | None) -> Solved | Refusal:
        """Return the pose that the landmarks agree on: of those that may vote; where few do, of those on trial too."""
        if self._config.landmarks < FEW and self._level.is_level:
            return self._solve_by_few(again, expected)
        able = np.asarray(~self._memory.is_moved[again.rows])
        voting = self._memory.votes(again.rows)
        answer = self._align(again.pick(voting), expected)
        n_agree = 0 if isinstance(answer, Refusal) else len(answer.agreeing)
        if n_agree < _ENOUGH and able.sum() > voting.sum():
            of_all = self._align(again.pick(able), expected)
            answer = answer if isinstance(of_all, Refusal) else of_all
        return answer

    def n_standing(self, solved: Solved, among: TrackedLandmarks) -> int:
        """Return how many landmarks that have not moved stand where a pose says."""
        able = among.pick(np.asarray(~self._memory.is_moved[among.rows]))
        return int(self.agree(*self.misses(solved, able)).sum()) if len(able) else 0

    def misses(self, solved: Solved, sighting: TrackedLandmarks) -> tuple[Floats, Floats]:
        """Return how far landmarks stand from where they are remembered, (N, 3), and its covariances, (N, 3, 3)."""
        R, t = solved.T_map_base[:3, :3], solved.T_map_base[:3, 3]
        points = sighting.seen.points_base @ R.T + t
        cov = R @ sighting.seen.cov_base @ R.T + _MODEL_SIGMA_M**2 * np.eye(3)
        return points - self._memory.points[sighting.rows], cov + self._memory.cov[sighting.rows]

    def agree(self, misses: Floats, cov: Floats, gate: float = _GATE) -> npt.NDArray[np.bool_]:
        """Return whether landmarks that miss by so much stand where they are remembered."""
        D = self.n_dimensions
        information = np.linalg.inv(cov[:, :D, :D])
        squared = np.einsum("ni,nij,nj->n", misses[:, :D], information, misses[:, :D])
        return np.atleast_1d(squared < gate)

    def forget(self) -> None:
        """Take no pose before for known."""
        self._spread = None

    def _solve_by_few(self, again: TrackedLandmarks, expected: Expected | None) -> Solved | Refusal:
        """Return the pose of the few landmarks that tell most, if the others that are followed do not contradict it.

        The expectation chooses landmarks as it is. It steadies the pose only as far as the last pose was known: few
        landmarks yield to it, so that it would be borne out by itself, and lead astray.
        """
        begun = None if expected is None or self._spread is None else expected.begun_from(self._spread)
        answer = self._pose_of_few(again, expected, begun or expected)
        if isinstance(answer, Solved):
            self._spread = answer.covariance
        return answer

    def _pose_of_few(
        self, again: TrackedLandmarks, expected: Expected | None, begun: Expected | None
    ) -> Solved | Refusal:
        memory = self._memory
        able = again.pick(np.asarray(~memory.is_moved[again.rows]))
        as_expected = able if expected is None else able.pick(self._within_expectation(able, expected))
        # a thing that is carried past may show more of them than the room
        if len(as_expected) >= self._config.landmarks:
            able = as_expected
        voting = able.pick(memory.votes(able.rows))
        among = voting if len(voting) >= self._config.landmarks else able
        answer = self._align(self._few_of(among, begun), begun)
        if isinstance(answer, Refusal) or len(voting) <= self._config.landmarks:
            return answer
        if self._support(answer, voting) >= _SUPPORT:
            return answer
        of_all = self._align(voting, begun)  # one of the few may have begun to move: who disagrees is left out
        if isinstance(of_all, Refusal) or self._support(of_all, voting) < _SUPPORT:
            return Refusal("the landmarks contradict one another")
        agreeing = of_all.agreeing
        return self._align(self._few_of(agreeing, begun), begun)

    def _few_of(self, among: TrackedLandmarks, begun: Expected | None) -> TrackedLandmarks:
        """Return the few that tell most, of those that closely agree with the pose of all where most of all agree.

        What begins to move is within the gate for some pictures. It hardly counts among many, and much among three.
        """
        if len(among) > self._config.landmarks:
            of_all = self._align(among, begun)
            if isinstance(of_all, Solved) and self._support(of_all, among) >= _SUPPORT:
                closely = among.pick(self.agree(*self.misses(of_all, among), _CLOSELY))
                among = closely if len(closely) >= self._config.landmarks else among
        return among.pick(self._most_telling(among))

    def _within_expectation(self, sighting: TrackedLandmarks, expected: Expected) -> npt.NDArray[np.bool_]:
        D = len(expected.t)
        seen, rows = sighting.seen, sighting.rows
        cov_now = seen.cov_base[:, :D, :D] + _MODEL_SIGMA_M**2 * np.eye(D)
        points, cov = self._memory.points[rows][:, :D], self._memory.cov[rows][:, :D, :D]
        return reachable(points, seen.points_base[:, :D], cov, cov_now, expected)

    def _support(self, solved: Solved, among: TrackedLandmarks) -> float:
        """Return the share of landmarks that stand where a pose says."""
        misses, cov = self.misses(solved, among)
        return float(self.agree(misses, cov).mean())

    def _most_telling(self, sighting: TrackedLandmarks) -> Indices:
        """Return the rows of the few landmarks that leave the planar pose least uncertain, chosen one by one.

        A landmark counts as exact as it was measured and as the pose from which it was remembered: old ones are
        preferred, and those that stand apart.
        """
        n, wanted = len(sighting), self._config.landmarks
        if n <= wanted:
            return np.arange(n)
        points = sighting.seen.points_base[:, :2]
        cov = sighting.seen.cov_base[:, :2, :2] + self._memory.cov[sighting.rows][:, :2, :2]
        anchor = np.trace(self._memory.anchor_cov[sighting.rows][:, :2, :2], axis1=1, axis2=2) / 2.0
        cov = cov + (anchor + _MODEL_SIGMA_M**2)[:, None, None] * np.eye(2)
        J = jacobian(points)
        information = J.transpose(0, 2, 1) @ np.linalg.inv(cov) @ J
        total, chosen = 1e-3 * np.eye(3), list[int]()
        for _ in range(wanted):
            spread = np.trace(np.linalg.inv(total + information), axis1=1, axis2=2)
            spread[chosen] = np.inf
            chosen.append(int(spread.argmin()))
            total = total + information[chosen[-1]]
        return np.array(sorted(chosen), dtype=np.intp)

    def _align(self, sighting: TrackedLandmarks, expected: Expected | None) -> Solved | Refusal:
        D = self.n_dimensions
        memory, seen = self._memory, sighting.seen
        model = _MODEL_SIGMA_M**2 * np.eye(D)
        answer = align(
            memory.points[sighting.rows][:, :D],
            seen.points_base[:, :D],
            memory.cov[sighting.rows][:, :D, :D],
            seen.cov_base[:, :D, :D] + model,
            rng=self._rng,
            limits=self._limits,
            expected=expected,
        )
        if isinstance(answer, Refusal):
            return answer
        agreeing = sighting.pick(answer.inliers)
        anchored = memory.anchor_cov[agreeing.rows].mean(axis=0)
        covariance = planar_covariance(answer) + anchored
        T_map_base = _homogeneous(answer)
        depth_m = float(np.linalg.norm(agreeing.seen.points_base, axis=1).mean())
        drift = memory.drift(agreeing.rows, T_map_base, depth_m)
        return Solved(T_map_base, covariance, agreeing, answer.residual_m, drift)


def _homogeneous(alignment: CloudAlignment) -> Floats:
    D = len(alignment.t)
    T = np.eye(4)
    T[:D, :D], T[:D, 3] = alignment.R, alignment.t
    return T
