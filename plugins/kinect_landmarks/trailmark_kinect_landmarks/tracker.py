"""Which landmarks of the memory are in the picture, and what is learned of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from trailmark.arrays import Floats, Indices
from trailmark_kinect_landmarks.camera import LandmarkCamera
from trailmark_kinect_landmarks.config import FEW, KinectLandmarksConfig
from trailmark_kinect_landmarks.expectation import LEARNS_EVERY_S
from trailmark_kinect_landmarks.eye import LandmarkDetector, PreparedImage
from trailmark_kinect_landmarks.fuzzy import SearchPlan
from trailmark_kinect_landmarks.landmarks import SeenLandmarks, TrackedLandmarks
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
from trailmark_kinect_landmarks.solver import PoseSolver, Solved
from trailmark_kinect_landmarks.whereabouts import Lead

__all__ = ["Tracker"]


_STILL_ALIKE = 0.35  # a followed landmark that looks less like itself has slid off


class Tracker:
    """Finds remembered landmarks again, and learns from the pose that they carry.

    Parameters
    ----------
    config : KinectLandmarksConfig
        How.
    camera, eye, memory
        The parts that measure, see and remember.
    solver : PoseSolver
        Says which landmarks agree with a pose.

    Attributes
    ----------
    n_near : int
        Landmarks of the last picture that were found again where motions lead; 0 where that was not asked.
    """

    def __init__(
        self,
        config: KinectLandmarksConfig,
        camera: LandmarkCamera,
        eye: LandmarkDetector,
        memory: LandmarkMemory,
        solver: PoseSolver,
    ) -> None:
        self._config, self._camera, self._eye, self._memory = config, camera, eye, memory
        self._solver = solver
        self._before: PreparedImage | None = None
        self._learned_s = -math.inf
        self._rests = False  # whether finders were left out of the last picture
        self._followed: tuple[Indices, Floats] = (np.empty(0, np.intp), np.empty((0, 2)))
        self.n_near = 0

    def look(
        self, picture: PreparedImage, plan: SearchPlan, T_map_base: Floats | None, lead: Lead | None = None
    ) -> tuple[TrackedLandmarks, TrackedLandmarks, SearchPlan]:
        """Return the landmarks that are found again, all others that are seen, and what of the plan was done.

        `T_map_base` is predicted; without it all that is remembered is searched, first what is where motions `lead`.
        While finders rest, none is in the plan that was done.
        """
        numbers = self._memory.forget(self._followed[0])
        if numbers is not None:
            self._followed = numbers[self._followed[0]], self._followed[1]
        again = self._follow(picture, plan, T_map_base)
        found = self._find(picture, plan, again)
        done = replace(plan, finders=()) if self._rests else plan
        if T_map_base is None:
            pairs, n_near = self._recognise_anywhere(found, again, plan, lead)
        else:
            pairs, n_near = self._recognise(found, again.rows, picture, plan, T_map_base), 0
        others = np.setdiff1d(np.arange(len(found)), pairs[:, 0])
        again = TrackedLandmarks.join([again, TrackedLandmarks(found.rows(pairs[:, 0]), pairs[:, 1])])
        self._before = picture
        self._followed = again.rows, again.seen.uv
        self.n_near = n_near
        measured = np.flatnonzero(np.isfinite(again.seen.points_base).all(axis=1))
        return again.pick(measured), TrackedLandmarks(found.rows(others), np.full(len(others), -1, np.intp)), done

    def learn(
        self, stamp_s: float, solved: Solved, again: TrackedLandmarks, others: TrackedLandmarks, *, is_doubtful: bool
    ) -> Indices:
        """Refine what agrees, count what does not, remember what is new; returns the rows that passed their trial.

        Of those that are followed it learns now and then, however fast pictures come; new ones are taken from each.
        Few, and those that are found again by looks, come and go: of these it learns by each. By a doubtful pose
        nothing is learned: it may be that of a near thing which is carried off, and what is remembered shows that.
        """
        misses, spread = self._solver.misses(solved, again)
        points, cov = misses + self._memory.points[again.rows], spread - self._memory.cov[again.rows]
        agrees = self._solver.agree(misses, spread)
        passed: Indices = np.empty(0, np.intp)
        comes_and_goes = self._config.landmarks < FEW or self._config.refind != "flow"
        if not is_doubtful:
            self._memory.disagree(again.rows[~agrees])
            if comes_and_goes or not 0.0 <= stamp_s - self._learned_s < LEARNS_EVERY_S:
                self._learned_s, agreeing = stamp_s, again.rows[agrees]
                self._memory.agree(agreeing, points[agrees], cov[agrees])
                passed = agreeing[self._memory.n_seen[agreeing] == self._memory.limits.trial]
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
        self, found: SeenLandmarks, taken: Indices, picture: PreparedImage, plan: SearchPlan, T_map_base: Floats
    ) -> Indices:
        """Return pairs (row of `found`, row of the memory) near where they are predicted, (K, 2)."""
        memory, rows, radius_px = self._memory, self._free(taken), self._config.search_px
        expected = self._expected_pixels(rows, picture, T_map_base)
        near = np.all((expected > -radius_px) & (expected < np.array(picture.size) + radius_px), axis=1)
        rows, expected = rows[near], expected[near]
        if len(rows) == 0 or len(found) == 0:
            return np.empty((0, 2), np.intp)
        sizes = found.size_m, memory.size_m[rows]
        alike = resemblance_where(
            is_near(found.uv, expected, radius_px), found.histogram, found.vicinity, memory.histogram[rows],
            memory.vicinity[rows], plan.by_colour,
        )  # fmt: skip
        pairs = match_near(alike, found.uv, expected, radius_px, *sizes, self._config.alike)
        return np.stack([pairs[:, 0], rows[pairs[:, 1]]], axis=1)

    def _recognise_anywhere(
        self, found: SeenLandmarks, again: TrackedLandmarks, plan: SearchPlan, lead: Lead | None
    ) -> tuple[Indices, int]:
        """Return pairs that are consistent, (K, 2), and how many are where motions lead.

        Looks alone choose the place in which most landmarks look alike, were it by one. So those where motions lead are
        taken if they are half as many, or enough.
        """
        rows = self._free(again.rows)
        of_all = self._consistent(found, rows, plan, None)
        if lead is None:
            return of_all, 0
        n_followed = len(again) if lead.carries(again.seen.points_base, self._memory.points[again.rows]) else 0
        near = self._consistent(found, rows, plan, lead)
        if not lead.carries(found.points_base[near[:, 0]], self._memory.points[near[:, 1]]):
            return of_all, n_followed
        is_enough = len(near) >= min(self._config.min_agreeing, max(1, len(of_all) // 2))
        return near if is_enough else of_all, n_followed + len(near)

    def _consistent(self, found: SeenLandmarks, rows: Indices, plan: SearchPlan, lead: Lead | None) -> Indices:
        memory = self._memory
        if lead is not None:  # others that look alike are not among the best three of each
            here = np.linalg.norm(memory.points[rows] - lead.T_map_base[:3, 3], axis=1)
            rows = rows[here < self._config.far_m + lead.reach_m]
        if len(rows) == 0 or len(found) == 0:
            return np.empty((0, 2), np.intp)
        alike = resemblance(
            found.histogram, found.vicinity, memory.histogram[rows], memory.vicinity[rows], plan.by_colour
        )
        pairs = match_anywhere(alike, found.size_m, memory.size_m[rows], self._config.alike)
        if lead is not None:
            pairs = pairs[lead.reaches(found.points_base[pairs[:, 0]], memory.points[rows][pairs[:, 1]])]
        pairs = consistent(pairs, found.points_base, memory.points[rows])
        return np.stack([pairs[:, 0], rows[pairs[:, 1]]], axis=1)

    def _free(self, taken: Indices) -> Indices:
        """Return the rows that are not followed already, and have not moved."""
        free = ~self._memory.is_moved
        free[taken] = False
        return np.flatnonzero(free)

    def _expected_pixels(self, rows: Indices, picture: PreparedImage, T_map_base: Floats) -> Floats:
        points_base = (self._memory.points[rows] - T_map_base[:3, 3]) @ T_map_base[:3, :3]
        return self._camera.project(points_base, picture.size)

    def let_go(self) -> None:
        """Follow no landmark on: they were taken for others."""
        self._solver.forget()
        self._followed = np.empty(0, np.intp), np.empty((0, 2))

    def forget(self) -> None:
        """Follow nothing any more, and take no pose before for known."""
        self._before = None
        self.let_go()
