"""Which landmarks of the memory are in the picture, and the pose they carry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
from trailmark_kinect_landmarks.camera import LandmarkCamera
from trailmark_kinect_landmarks.config import FEW, KinectLandmarksConfig
from trailmark_kinect_landmarks.expectation import Expected
from trailmark_kinect_landmarks.eye import LandmarkDetector, PreparedImage
from trailmark_kinect_landmarks.fuzzy import SearchPlan
from trailmark_kinect_landmarks.landmarks import SeenLandmarks
from trailmark_kinect_landmarks.level import LevelWatch
from trailmark_kinect_landmarks.memory import Anchor, LandmarkMemory
from trailmark_kinect_landmarks.refinding import (
    consistent,
    follow,
    is_near,
    match_anywhere,
    match_near,
    resemblance,
    resemblance_where,
)
from trailmark_kinect_landmarks.systematic import TravelledWay

__all__ = ["Solved", "TrackedLandmarks", "Tracker"]


_STILL_ALIKE = 0.35  # a followed landmark that looks less like itself has slid off
_ENOUGH = 12  # landmarks that agree, so that those on trial need not be asked
_SUPPORT = 0.7  # of the candidates that must agree with the pose of the few
_CLOSELY = 4.0  # squared sigmas within which a candidate may be one of the few: each of three has its way
_GATE = 16.3  # chi-square of three numbers, 99.9 %
_MODEL_SIGMA_M = 0.004  # what calibration and rounding of depth add to every point


@dataclass(frozen=True, slots=True, eq=False)
class TrackedLandmarks:
    """Landmarks of a picture with their rows in the memory.

    Attributes
    ----------
    seen : SeenLandmarks
        What is seen.
    rows : (N,) int
        Their rows; -1: not known yet.
    """

    seen: SeenLandmarks
    rows: Indices

    def __len__(self) -> int:
        return len(self.rows)

    def pick(self, which: Indices | npt.NDArray[np.bool_]) -> TrackedLandmarks:
        """Return some of them."""
        return TrackedLandmarks(self.seen.rows(which), self.rows[which])


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


class Tracker:
    """Finds remembered landmarks again and solves for the pose.

    Parameters
    ----------
    config : KinectLandmarksConfig
        How.
    camera, eye, memory
        The parts that measure, see and remember.
    limits : AlignmentLimits
        When landmarks carry a pose.
    rng : Generator
        Draws minimal sets.
    """

    def __init__(
        self,
        config: KinectLandmarksConfig,
        camera: LandmarkCamera,
        eye: LandmarkDetector,
        memory: LandmarkMemory,
        limits: AlignmentLimits,
        rng: np.random.Generator,
    ) -> None:
        self._config, self._camera, self._eye, self._memory = config, camera, eye, memory
        self._limits, self._rng = limits, rng
        self._level = LevelWatch(config.solve == "plane", notices=config.notice_tilt)
        self._before: PreparedImage | None = None
        self._spread: Floats | None = None  # covariance of the last pose of the few
        self._rests = False  # whether finders were left out of the last picture
        self._followed: tuple[Indices, Floats] = (np.empty(0, np.intp), np.empty((0, 2)))

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

    def look(
        self, picture: PreparedImage, plan: SearchPlan, T_map_base: Floats | None
    ) -> tuple[TrackedLandmarks, TrackedLandmarks, SearchPlan]:
        """Return the landmarks that are found again, all others that are seen, and what of the plan was done.

        `T_map_base` is predicted. While finders rest, none is in the plan that was done.
        """
        numbers = self._memory.forget(self._followed[0])
        if numbers is not None:
            self._followed = numbers[self._followed[0]], self._followed[1]
        again = self._follow(picture, plan, T_map_base)
        found = self._find(picture, plan, again)
        done = replace(plan, finders=()) if self._rests else plan
        pairs = self._recognise(found, again.rows, picture, plan, T_map_base)
        others = np.setdiff1d(np.arange(len(found)), pairs[:, 0])
        again = _join([again, TrackedLandmarks(found.rows(pairs[:, 0]), pairs[:, 1])])
        self._before = picture
        self._followed = again.rows, again.seen.uv
        measured = np.flatnonzero(np.isfinite(again.seen.points_base).all(axis=1))
        return again.pick(measured), TrackedLandmarks(found.rows(others), np.full(len(others), -1, np.intp)), done

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
        if (
            len(as_expected) >= self._config.landmarks
        ):  # a thing that is carried past may show more of them than the room
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
                closely = among.pick(self._agree(*self._misses(of_all, among), _CLOSELY))
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
        misses, cov = self._misses(solved, among)
        return float(self._agree(misses, cov).mean())

    def n_taught(self, solved: Solved, among: TrackedLandmarks) -> int:
        """Return how many landmarks of a taught place stand where a pose says."""
        taught = among.pick(np.asarray(self._memory.is_taught[among.rows] & ~self._memory.is_moved[among.rows]))
        return int(self._agree(*self._misses(solved, taught)).sum()) if len(taught) else 0

    def _misses(self, solved: Solved, sighting: TrackedLandmarks) -> tuple[Floats, Floats]:
        R, t = solved.T_map_base[:3, :3], solved.T_map_base[:3, 3]
        points = sighting.seen.points_base @ R.T + t
        cov = R @ sighting.seen.cov_base @ R.T + _MODEL_SIGMA_M**2 * np.eye(3)
        return points - self._memory.points[sighting.rows], cov + self._memory.cov[sighting.rows]

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

    def learn(self, solved: Solved, again: TrackedLandmarks, others: TrackedLandmarks) -> Indices:
        """Refine what agrees, count what does not, remember what is new; returns the rows that passed their trial."""
        misses, spread = self._misses(solved, again)
        points, cov = misses + self._memory.points[again.rows], spread - self._memory.cov[again.rows]
        agrees = self._agree(misses, spread)
        self._memory.agree(again.rows[agrees], points[agrees], cov[agrees])
        self._memory.disagree(again.rows[~agrees])
        agreeing = again.rows[agrees]
        passed: Indices = agreeing[self._memory.n_seen[agreeing] == self._memory.limits.trial]
        rows, uv = self._followed
        stays = ~np.isin(rows, again.rows[~agrees])
        room = max(0, self._config.n_followed - int(agrees.sum()))
        new = others.seen.rows(np.arange(min(room, len(others))))
        new_rows = self._memory.add(new, Anchor(solved.T_map_base, solved.covariance, solved.drift), is_trusted=False)
        self._keep(rows[stays], uv[stays], new_rows, new.uv)
        return passed

    def remember(self, others: TrackedLandmarks, anchor: Anchor) -> Indices:
        """Remember all that is seen from a pose that is taken for granted; returns the new rows."""
        rows = self._memory.add(others.seen, anchor, is_trusted=True)
        self._keep(np.empty(0, np.intp), np.empty((0, 2)), rows, others.seen.uv)
        return rows

    def _keep(self, rows: Indices, uv: Floats, new_rows: Indices, new_uv: Floats) -> None:
        self._followed = np.concatenate([rows, new_rows]), np.concatenate([uv, new_uv])

    def _find(self, picture: PreparedImage, plan: SearchPlan, again: TrackedLandmarks) -> SeenLandmarks:
        """Return what is seen beside the landmarks that are followed.

        Where these are as many as are wanted, and not few, finders look at every second picture only.
        """
        wanted = self._config.n_followed - len(again)
        self._rests = wanted <= 0 and not self._rests and self._config.landmarks >= FEW
        if self._rests:
            return again.seen.rows(np.empty(0, np.intp))
        return self._eye.find(picture, plan, again.seen.uv, max(wanted, self._config.n_followed // 3))

    def _follow(self, picture: PreparedImage, plan: SearchPlan, T_map_base: Floats | None) -> TrackedLandmarks:
        """Follow the landmarks of the picture before; those that slid off or were set aside are let go."""
        rows, uv = self._followed
        kept = ~self._memory.is_moved[rows]
        rows, uv = rows[kept], uv[kept]
        if self._before is None or self._config.refind != "flow" or self._before.size != picture.size:
            rows, uv = rows[:0], uv[:0]
        if len(rows) == 0:
            return TrackedLandmarks(self._eye.look_at(picture, uv, np.empty(0, np.int8), np.empty(0)), rows)
        assert self._before is not None
        guess = None if T_map_base is None else self._expected_pixels(rows, picture, T_map_base)
        if guess is not None:
            guess = np.where(np.isfinite(guess), guess, uv)
        now, good = follow(self._before.grey, picture.grey, uv, guess)
        rows, now = rows[good], now[good]
        seen = self._eye.look_at(picture, now, self._memory.kind[rows], np.ones(len(rows)))
        seen = replace(seen, size_m=self._memory.size_m[rows])
        alike = np.einsum("nc,nc->n", seen.vicinity, self._memory.vicinity[rows])
        still = alike >= _STILL_ALIKE
        return TrackedLandmarks(seen.rows(still), rows[still])

    def _recognise(
        self, found: SeenLandmarks, taken: Indices, picture: PreparedImage, plan: SearchPlan, T_map_base: Floats | None
    ) -> Indices:
        """Return pairs (row of `found`, row of the memory), (K, 2)."""
        memory = self._memory
        free = ~memory.is_moved
        free[taken] = False
        rows = np.flatnonzero(free)
        expected = None
        if T_map_base is not None and len(rows):
            expected = self._expected_pixels(rows, picture, T_map_base)
            near = np.all(
                (expected > -self._config.search_px) & (expected < np.array(picture.size) + self._config.search_px),
                axis=1,
            )
            rows, expected = rows[near], expected[near]
        if len(rows) == 0 or len(found) == 0:
            return np.empty((0, 2), np.intp)
        looks = found.histogram, found.vicinity, memory.histogram[rows], memory.vicinity[rows]
        if expected is None:
            alike = resemblance(*looks, plan.by_colour)
            pairs = match_anywhere(alike, found.size_m, memory.size_m[rows], self._config.alike)
            pairs = consistent(pairs, found.points_base, memory.points[rows])
        else:
            sizes = found.size_m, memory.size_m[rows]
            near = is_near(found.uv, expected, self._config.search_px)
            alike = resemblance_where(near, *looks, plan.by_colour)
            pairs = match_near(alike, found.uv, expected, self._config.search_px, *sizes, self._config.alike)
        return np.stack([pairs[:, 0], rows[pairs[:, 1]]], axis=1)

    def _expected_pixels(self, rows: Indices, picture: PreparedImage, T_map_base: Floats) -> Floats:
        points_base = (self._memory.points[rows] - T_map_base[:3, 3]) @ T_map_base[:3, :3]
        return self._camera.project(points_base, picture.size)

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

    def forget(self) -> None:
        """Follow nothing any more, and take no pose before for known."""
        self._before = self._spread = None
        self._followed = np.empty(0, np.intp), np.empty((0, 2))

    def _agree(self, misses: Floats, cov: Floats, gate: float = _GATE) -> npt.NDArray[np.bool_]:
        D = self.n_dimensions
        information = np.linalg.inv(cov[:, :D, :D])
        squared = np.einsum("ni,nij,nj->n", misses[:, :D], information, misses[:, :D])
        return np.atleast_1d(squared < gate)


def _homogeneous(alignment: CloudAlignment) -> Floats:
    D = len(alignment.t)
    T = np.eye(4)
    T[:D, :D], T[:D, 3] = alignment.R, alignment.t
    return T


def _join(parts: Sequence[TrackedLandmarks]) -> TrackedLandmarks:
    seen = [part.seen for part in parts if len(part)] or [parts[0].seen]
    fields = ("uv", "kind", "size_m", "histogram", "vicinity", "points_base", "cov_base")
    arrays = [np.concatenate([getattr(item, name) for item in seen]) for name in fields]
    return TrackedLandmarks(SeenLandmarks(*arrays), np.concatenate([part.rows for part in parts]))
