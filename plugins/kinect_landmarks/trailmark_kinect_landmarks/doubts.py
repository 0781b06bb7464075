"""Why a pose that was not followed from picture to picture is not believed: landmarks agree in more than one place."""

from __future__ import annotations

import math

import numpy as np

from trailmark.geometry import Pose2, Pose3
from trailmark_kinect_landmarks.camera import LandmarkCamera
from trailmark_kinect_landmarks.config import KinectLandmarksConfig
from trailmark_kinect_landmarks.eye import PreparedImage
from trailmark_kinect_landmarks.landmarks import TrackedLandmarks
from trailmark_kinect_landmarks.memory import LandmarkMemory
from trailmark_kinect_landmarks.place_likeness import in_view, place_likeness
from trailmark_kinect_landmarks.solver import PoseSolver, Solved
from trailmark_kinect_landmarks.whereabouts import NEAR_M, NEAR_RAD, Whereabouts

__all__ = ["Doubts"]

#: Of the landmarks that should be seen where motions lead, so many are found again where that is true.
_FOUND_SHARE = 0.25
#: Headings at which they must be missed, beside the one that motions lead to [rad].
_ASIDE_RAD = (-0.3, 0.3)


class Doubts:
    """What speaks against a pose that landmarks agree on: motions since the last one, and the looks of the place.

    Parameters
    ----------
    config : KinectLandmarksConfig
        How much is asked.
    memory, camera, solver
        Of the localizer.
    whereabouts : Whereabouts
        Where motions lead.
    """

    def __init__(
        self,
        config: KinectLandmarksConfig,
        memory: LandmarkMemory,
        camera: LandmarkCamera,
        solver: PoseSolver,
        whereabouts: Whereabouts,
    ) -> None:
        self._config, self._memory, self._camera, self._solver = config, memory, camera, solver
        self._whereabouts = whereabouts

    def about(self, solved: Solved, again: TrackedLandmarks, picture: PreparedImage) -> str:
        """Return why a pose is not believed; nothing where it is.

        Parameters
        ----------
        solved : Solved
            The pose, and the landmarks that agree on it.
        again : TrackedLandmarks
            All that were found again.
        picture : PreparedImage
            What is seen.
        """
        pose, led = _planar(solved), self._whereabouts.led
        if self._whereabouts.is_near(pose):
            return ""
        if led is None or self._whereabouts.is_possible(pose) or self._is_carried_off(led, again, picture):
            return self._about_looks(solved, again, picture)
        off_m, off_deg = led.distance_to(pose), math.degrees(abs(led.between(pose).theta))
        return (
            f"landmarks agree on a place {off_m:.1f} m and {off_deg:.0f} deg from where motions lead: it may be another"
            " that looks alike"
        )

    def is_surely_elsewhere(self, picture: PreparedImage) -> bool:
        """Return whether a camera that has stood since the last pose looks through what it saw from there."""
        led = self._whereabouts.led
        if led is None or not self._whereabouts.has_stood:
            return False
        return in_view(self._memory, self._camera, picture, Pose3.from_planar(led).matrix()).are_gone

    def _is_carried_off(self, led: Pose2, again: TrackedLandmarks, picture: PreparedImage) -> bool:
        """Return whether a picture in which landmarks are found again shows none of those of where motions lead."""
        aside = () if self._whereabouts.has_stood else _ASIDE_RAD
        poses = [Pose2(led.x, led.y, led.theta + turn) for turn in (0.0, *aside)]
        n = min(in_view(self._memory, self._camera, picture, Pose3.from_planar(pose).matrix()).n for pose in poses)
        return n >= self._config.min_agreeing and self._n_found_near(led, again) < _FOUND_SHARE * n

    def _n_found_near(self, led: Pose2, again: TrackedLandmarks) -> int:
        """Return how many landmarks agree on a pose near the one that motions lead to."""
        R, t = Pose3.from_planar(led).rotation(), np.array([led.x, led.y, 0.0])
        misses_m = np.linalg.norm(again.seen.points_base @ R.T + t - self._memory.points[again.rows], axis=1)
        reach_m = NEAR_M + NEAR_RAD * np.linalg.norm(again.seen.points_base, axis=1)
        solved = self._solver.solve(again.pick(misses_m < reach_m), None)
        is_near = isinstance(solved, Solved) and self._whereabouts.is_near(_planar(solved))
        return len(solved.agreeing) if isinstance(solved, Solved) and is_near else 0

    def _about_looks(self, solved: Solved, again: TrackedLandmarks, picture: PreparedImage) -> str:
        """Return why a pose is not believed to be in the taught place."""
        if not self._memory.is_taught.any():
            return ""
        n, needed = self._solver.n_taught(solved, again), self._config.min_agreeing
        if n < needed:
            return f"{n} taught landmarks agree on a place, {needed} are needed: it may be another"
        likeness = place_likeness(self._memory, self._camera, picture, solved.T_map_base)
        asked = self._config.place_alike
        if likeness is not None and likeness < asked:
            return f"what should be seen there looks alike to {likeness:.2f}, not {asked:.2f}: it may be another place"
        return ""


def _planar(solved: Solved) -> Pose2:
    return Pose3.from_matrix(solved.T_map_base).planar()
