"""How far apart keyframes are."""

from __future__ import annotations

from trailmark.geometry import Pose2

__all__ = ["KeyframeSpacing"]


class KeyframeSpacing:
    """Decides when the robot has moved or turned far enough for another keyframe.

    Parameters
    ----------
    distance_m : float
        Least way between two keyframes [m].
    turn_rad : float
        Least turn between two keyframes [rad].
    """

    def __init__(self, distance_m: float, turn_rad: float) -> None:
        self._distance_m, self._turn_rad = distance_m, turn_rad
        self._last: tuple[float, Pose2] | None = None

    def is_new_place(self, travelled_m: float, pose: Pose2) -> bool:
        """Return whether a keyframe belongs here."""
        if self._last is None:
            return True
        last_m, last_pose = self._last
        return travelled_m - last_m >= self._distance_m or abs(last_pose.between(pose).theta) >= self._turn_rad

    def add(self, travelled_m: float, pose: Pose2) -> None:
        """Note a keyframe that was taken here."""
        self._last = (travelled_m, pose)
