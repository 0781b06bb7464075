"""The robot's own odometry, for the transform from map to odom."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter, deque
from typing import Any

from trailmark.geometry import Pose2, Twist2
from trailmark.sources.ros_messages import planar_pose, planar_twist
from trailmark_ros2.frame_names import FrameNames

__all__ = ["RobotOdometry"]

_KEPT = 500
# Beyond its newest message the odometry is predicted by its velocity, so long at most [s].
_LONGEST_PREDICTION_S = 0.2
# Another program than the first may be found not to count: so many of its messages are waited for.
_N_SETTLED = 5


class RobotOdometry:
    """Where base was in the robot's odometry at recent stamps, by the program that sent the last message."""

    def __init__(self) -> None:
        self._names = FrameNames()
        self._writer = 0
        self._n_heard: Counter[int] = Counter()  # by writer, the first one first
        self._poses: deque[tuple[float, Pose2, Twist2 | None]] = deque(maxlen=_KEPT)

    @property
    def frame_id(self) -> str:
        """Frame of the odometry, as its messages say; empty before the first."""
        return self._names.frame_id

    def add(self, message: Any, writer: int = 0) -> None:
        """Take a message of nav_msgs/Odometry.

        Raises
        ------
        ValueError
            If it holds no pose.
        SourceError
            If it is of another frame than those before it.
        """
        stamp_s = message.header.stamp.sec + message.header.stamp.nanosec / 1e9
        pose = planar_pose(message.pose.pose)
        if self._names.note_message(message, writer) or writer != self._writer:
            self._poses.clear()  # they are of another origin
        self._writer = writer
        self._n_heard[writer] += 1
        if self._poses and stamp_s == self._poses[-1][0]:
            return  # a driver that sends its last reading again has not begun anew
        if self._poses and stamp_s < self._poses[-1][0]:
            self._poses.clear()  # it began anew: what was before is of another clock or origin
        self._poses.append((stamp_s, pose, planar_twist(message.twist.twist)))

    def pose_odom_base(self, stamp_s: float) -> Pose2 | None:
        """Return base in the odometry at a stamp: interpolated, or predicted for a short time; None: not known."""
        if not self._poses or stamp_s < self._poses[0][0] or not self._is_settled():
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

    def _is_settled(self) -> bool:
        return self._writer == next(iter(self._n_heard)) or self._n_heard[self._writer] >= _N_SETTLED
