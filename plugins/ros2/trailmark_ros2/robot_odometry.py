"""The robot's own odometry, for the transform from map to odom."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from typing import Any

from trailmark.geometry import Pose2, Twist2
from trailmark.sources.ros_messages import planar_pose, planar_twist

__all__ = ["RobotOdometry"]

_KEPT = 500
# Beyond its newest message the odometry is predicted by its velocity, so long at most [s].
_LONGEST_PREDICTION_S = 0.2


class RobotOdometry:
    """Where base was in the robot's odometry at recent stamps.

    Attributes
    ----------
    frame_id : str
        Frame of the odometry, as its messages say; empty before the first.
    """

    def __init__(self) -> None:
        self.frame_id = ""
        self._poses: deque[tuple[float, Pose2, Twist2 | None]] = deque(maxlen=_KEPT)

    def add(self, message: Any) -> None:
        """Take a message of nav_msgs/Odometry; raises ValueError where it holds no pose, or one in another frame."""
        stamp_s = message.header.stamp.sec + message.header.stamp.nanosec / 1e9
        pose = planar_pose(message.pose.pose)
        frame = str(message.header.frame_id).lstrip("/")
        if self.frame_id and frame != self.frame_id:
            raise ValueError(f"its frame is {frame!r}, and that of the messages before it was {self.frame_id!r}")
        if self._poses and stamp_s == self._poses[-1][0]:
            return  # a driver that sends its last reading again has not begun anew
        if self._poses and stamp_s < self._poses[-1][0]:
            self._poses.clear()  # it began anew: what was before is of another clock or origin
        self.frame_id = frame
        self._poses.append((stamp_s, pose, planar_twist(message.twist.twist)))

    def pose_odom_base(self, stamp_s: float) -> Pose2 | None:
        """Return base in the odometry at a stamp: interpolated, or predicted for a short time; None: not known."""
        if not self._poses or stamp_s < self._poses[0][0]:
            return None
        after = bisect_right(self._poses, stamp_s, key=lambda known: known[0])
        before_s, before, twist = self._poses[after - 1]
        if after < len(self._poses):
            after_s, then, _ = self._poses[after]
            return before.interpolate(then, (stamp_s - before_s) / (after_s - before_s))
        dt_s = stamp_s - before_s
        if dt_s == 0.0:
            return before
        return before @ twist.after(dt_s) if twist is not None and dt_s <= _LONGEST_PREDICTION_S else None
