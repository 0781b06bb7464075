"""Why a pose that was not followed from picture to picture is not believed: landmarks agree in more than one place."""

from __future__ import annotations

import math

from trailmark.geometry import Pose2, Pose3
from trailmark_kinect_landmarks.camera import LandmarkCamera
from trailmark_kinect_landmarks.config import KinectLandmarksConfig
from trailmark_kinect_landmarks.eye import PreparedImage
from trailmark_kinect_landmarks.landmarks import TrackedLandmarks
from trailmark_kinect_landmarks.memory import LandmarkMemory
from trailmark_kinect_landmarks.place_likeness import in_view, place_likeness
from trailmark_kinect_landmarks.solver import PoseSolver, Solved
from trailmark_kinect_landmarks.whereabouts import Lead, Whereabouts

__all__ = ["Doubts"]

#: So many landmarks should be seen where motions lead, and less than such a share of them is: it is not there.
_LEAST_IN_VIEW, _FOUND_SHARE = 12, 0.25
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

    def about(self, solved: Solved, again: TrackedLandmarks, n_near: int, picture: PreparedImage) -> str:
        """Return why a pose is not believed.

        Parameters
        ----------
        solved : Solved
            The pose, and the landmarks that agree on it.
        again : TrackedLandmarks
            All that were found again.
        n_near : int
            Landmarks that are found again where motions lead, as `Tracker.n_near`.
        picture : PreparedImage
            What is seen.

        Returns
        -------
        str
            The reason; empty where it is believed.
        """
        pose, lead = Pose3.from_matrix(solved.T_map_base).planar(), self._whereabouts.lead
        if self._whereabouts.is_near(pose):
            return ""
        if lead is None or self._whereabouts.is_possible(pose) or self._is_carried_off(lead, n_near, picture):
            return self._about_looks(solved, again, picture)
        off_m, off_deg = lead.pose.distance_to(pose), math.degrees(abs(lead.pose.between(pose).theta))
        return (
            f"landmarks agree on a place {off_m:.1f} m and {off_deg:.0f} deg from where motions lead: it may be another"
            " that looks alike"
        )

    def is_surely_elsewhere(self, picture: PreparedImage) -> bool:
        """Return whether a camera that has stood since the last pose looks through what it saw from there."""
        lead = self._whereabouts.lead
        if lead is None or not self._whereabouts.has_stood:
            return False
        return in_view(self._memory, self._camera, picture, lead.T_map_base).are_gone

    def _is_carried_off(self, lead: Lead, n_near: int, picture: PreparedImage) -> bool:
        """Return whether hardly any landmark is found again that should be seen where motions lead."""
        turns = (0.0,) if self._whereabouts.has_stood else (0.0, *_ASIDE_RAD)
        poses = [lead.T_map_base @ Pose3.from_planar(Pose2(theta=turn)).matrix() for turn in turns]
        n = min(in_view(self._memory, self._camera, picture, pose).n for pose in poses)
        return n >= _LEAST_IN_VIEW and n_near < _FOUND_SHARE * n

    def _about_looks(self, solved: Solved, again: TrackedLandmarks, picture: PreparedImage) -> str:
        """Return why a pose is not believed to be in what is remembered."""
        n, needed = self._solver.n_standing(solved, again), self._config.min_agreeing
        if n < needed:
            return f"{n} landmarks agree on a place, {needed} are needed: it may be another"
        likeness = place_likeness(self._memory, self._camera, picture, solved.T_map_base)
        asked = self._config.place_alike
        if likeness is not None and likeness < asked:
            return f"what should be seen there looks alike to {likeness:.2f}, not {asked:.2f}: it may be another place"
        return ""
