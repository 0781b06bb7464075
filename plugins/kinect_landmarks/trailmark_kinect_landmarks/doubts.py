"""Why a pose that was not followed from picture to picture is not believed: landmarks agree in more than one place."""

from __future__ import annotations

import numpy as np

from trailmark.estimates import Belief
from trailmark.geometry import Pose2, Pose3
from trailmark_kinect_landmarks.camera import LandmarkCamera
from trailmark_kinect_landmarks.config import KinectLandmarksConfig
from trailmark_kinect_landmarks.eye import PreparedImage
from trailmark_kinect_landmarks.landmarks import TrackedLandmarks
from trailmark_kinect_landmarks.memory import LandmarkMemory
from trailmark_kinect_landmarks.place_likeness import is_elsewhere, place_likeness
from trailmark_kinect_landmarks.solver import PoseSolver, Solved
from trailmark_kinect_landmarks.whereabouts import Whereabouts, is_in_reach

__all__ = ["Doubts"]

#: After so short a way motions tell to the pixel where the camera is [m].
_STOOD_M = 0.02


class Doubts:
    """What speaks against a pose that landmarks agree on: motions since the last one, and the looks of the place.

    Parameters
    ----------
    config : KinectLandmarksConfig
        How much is asked.
    memory, camera, solver
        Of the localizer.
    """

    def __init__(
        self, config: KinectLandmarksConfig, memory: LandmarkMemory, camera: LandmarkCamera, solver: PoseSolver
    ) -> None:
        self._config, self._memory, self._camera, self._solver = config, memory, camera, solver
        self.whereabouts = Whereabouts(config.restart_s)

    def of(
        self,
        solved: Solved,
        again: TrackedLandmarks,
        picture: PreparedImage,
        belief: Belief,
        assumed: Pose2 | None,
    ) -> str:
        """Return why a pose is not believed; nothing where it is.

        Parameters
        ----------
        solved : Solved
            The pose, and the landmarks that agree on it.
        again : TrackedLandmarks
            All that were found again.
        picture : PreparedImage
            What is seen.
        belief : Belief
            Of motion.
        assumed : Pose2 or None
            Told as the start, or landmarks were remembered anew there: near it nothing is doubted.
        """
        pose = Pose3.from_matrix(solved.T_map_base).planar()
        if assumed is not None and is_in_reach(pose, assumed):
            return ""
        return self._by_motion(pose, picture, belief) or self._by_looks(solved, again, picture)

    def is_carried_off(self, picture: PreparedImage, belief: Belief) -> bool:
        """Return whether a picture proves that the camera is not where motions lead."""
        carried = self.whereabouts.carried(belief)
        if carried is None:
            return False
        alike = self._config.place_alike if self.whereabouts.way_m(belief) < _STOOD_M else None
        return is_elsewhere(self._memory, self._camera, picture, Pose3.from_planar(carried).matrix(), alike)

    def _by_motion(self, pose: Pose2, picture: PreparedImage, belief: Belief) -> str:
        carried = self.whereabouts.carried(belief)
        if carried is None or is_in_reach(pose, carried, self.whereabouts.way_m(belief)):
            return ""
        if self.is_carried_off(picture, belief):
            return ""
        turned_deg = abs(np.rad2deg(carried.between(pose).theta))
        return (
            f"landmarks agree on a place {carried.distance_to(pose):.1f} m and {turned_deg:.0f} deg from where motions"
            " lead: it may be another that looks alike"
        )

    def _by_looks(self, solved: Solved, again: TrackedLandmarks, picture: PreparedImage) -> str:
        if not self._memory.is_taught.any():
            return ""
        n, needed = self._solver.n_taught(solved, again), self._config.min_agreeing
        if n < needed:
            return f"{n} taught landmarks agree on a place, {needed} are needed: it may be another"
        likeness = place_likeness(self._memory, self._camera, picture, solved.T_map_base)
        if likeness is not None and likeness < self._config.place_alike:
            return (
                f"what should be seen there looks alike to {likeness:.2f}, not {self._config.place_alike}: it may be"
                " another place"
            )
        return ""
