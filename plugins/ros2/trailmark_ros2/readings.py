"""From live messages to payloads: one reader a topic, which keeps what the next message builds on."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from types import SimpleNamespace
from typing import Any, ClassVar

from trailmark.frames import Odometry, Payload
from trailmark.geometry import Pose2, Twist2, wrap_angle
from trailmark.sources import ros_messages
from trailmark.sources.ros_poses import POSE_TYPES, LocalPlane, has_fix, pose_record
from trailmark_ros2.clouds import points_of, slice_as_scan
from trailmark_ros2.config import TopicOptions

__all__ = ["UNDERSTOOD", "Reader", "new_reader"]

_TRANSFORMS = "tf2_msgs/msg/TFMessage"
_TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
_CLOUD = "sensor_msgs/msg/PointCloud2"

# An odometry whose pose jumps by more than this from one message to the next was put back to its start ...
_RESTART_M = 0.5
# ... which is here.
_NEAR_ZERO_M = 0.05
# Another writer's pose continues the last one's if it is no farther away, and turned no farther.
_SAME_M = 0.1
_SAME_RAD = 0.2


class Reader(ABC):
    """Turns the messages of one topic into payloads.

    Attributes
    ----------
    restarts : int
        How often the sender began anew at another origin.
    """

    kind: ClassVar[str]

    def __init__(self, options: TopicOptions) -> None:
        self.options = options
        self.restarts = 0

    def own_part(self, message: Any) -> Any:
        """Return what of a message is for this reader, with a header; None: nothing."""
        return message

    @abstractmethod
    def payload(self, message: Any, stamp_s: float, writer: int) -> Payload | None:
        """Return the reading of a message; None: it holds none.

        Raises
        ------
        SourceError, ValueError, TypeError, AttributeError, IndexError
            If the message cannot be used.
        """


class _Picture(Reader):
    kind = "image"

    def payload(self, message: Any, stamp_s: float, writer: int) -> Payload:
        return ros_messages.image(message, self.options.topic)


class _LaserScan(Reader):
    kind = "scan"

    def payload(self, message: Any, stamp_s: float, writer: int) -> Payload:
        return ros_messages.scan(message)


class _Cloud(Reader):
    kind = "scan"

    def payload(self, message: Any, stamp_s: float, writer: int) -> Payload:
        points = points_of(message, self.options.topic)
        return slice_as_scan(points, self.options.height_m, math.radians(self.options.angle_step_deg))


class _Inertial(Reader):
    kind = "imu"

    def payload(self, message: Any, stamp_s: float, writer: int) -> Payload:
        return ros_messages.imu(message)


class _Pose(Reader):
    kind = "pose"

    def __init__(self, options: TopicOptions) -> None:
        super().__init__(options)
        self._plane = LocalPlane()

    def payload(self, message: Any, stamp_s: float, writer: int) -> Payload | None:
        return pose_record(message, self._plane) if has_fix(message) else None


class _OdometryReader(Reader):
    """Wheels. A sender that begins anew at another origin goes on where it was: the way since our start counts."""

    kind = "odometry"

    def __init__(self, options: TopicOptions) -> None:
        super().__init__(options)
        self._pose_odom_start: Pose2 | None = None
        self._last: tuple[Pose2, int] | None = None

    def payload(self, message: Any, stamp_s: float, writer: int) -> Payload:
        pose_odom_base = ros_messages.planar_pose(message.pose.pose)
        if self._pose_odom_start is None:
            self._pose_odom_start = pose_odom_base
        elif self._last is not None and self._began_anew(pose_odom_base, writer, *self._last):
            pose_start_last = self._pose_odom_start.inverse() @ self._last[0]
            self._pose_odom_start = pose_odom_base @ pose_start_last.inverse()
            self.restarts += 1
        self._last = pose_odom_base, writer
        return self._odometry(message, self._pose_odom_start)

    def _odometry(self, message: Any, pose_odom_start: Pose2) -> Odometry:
        return ros_messages.odometry(message, pose_odom_start)

    @staticmethod
    def _began_anew(pose: Pose2, writer: int, last: Pose2, last_writer: int) -> bool:
        jump_m = last.distance_to(pose)
        if writer != last_writer:
            return jump_m > _SAME_M or abs(wrap_angle(pose.theta - last.theta)) > _SAME_RAD
        return jump_m > _RESTART_M and math.hypot(pose.x, pose.y) < _NEAR_ZERO_M


class _TransformReader(_OdometryReader):
    """The odometry of a robot that tells it by /tf alone; it knows no velocity."""

    def own_part(self, message: Any) -> Any:
        ends = (self.options.odom_frame, self.options.base_frame)
        own = None
        for link in message.transforms:
            if (link.header.frame_id.lstrip("/"), link.child_frame_id.lstrip("/")) == ends:
                pose = SimpleNamespace(position=link.transform.translation, orientation=link.transform.rotation)
                own = SimpleNamespace(header=link.header, pose=SimpleNamespace(pose=pose))
        return own

    def _odometry(self, message: Any, pose_odom_start: Pose2) -> Odometry:
        return Odometry(pose_odom_start.inverse() @ ros_messages.planar_pose(message.pose.pose))


class _TwistReader(Reader):
    """Velocities, which hold until the next one: ``pose_k+1 = pose_k exp(twist_k dt)``."""

    kind = "odometry"

    # A velocity does not hold for longer: who sends none any more has stopped, or is gone.
    _HOLDS_S = 0.5

    def __init__(self, options: TopicOptions) -> None:
        super().__init__(options)
        self._pose = Pose2()
        self._last: tuple[float, Twist2] | None = None

    def payload(self, message: Any, stamp_s: float, writer: int) -> Payload:
        linear, angular = message.twist.linear, message.twist.angular
        twist = Twist2(float(linear.x), float(linear.y), float(angular.z))
        if not all(math.isfinite(part) for part in (twist.forward_mps, twist.left_mps, twist.yaw_radps)):
            raise ValueError("the velocity is not finite")
        if self._last is not None:
            last_s, last_twist = self._last
            self._pose = self._pose @ last_twist.after(min(max(stamp_s - last_s, 0.0), self._HOLDS_S))
        self._last = stamp_s, twist
        return Odometry(self._pose, twist=twist)


_READERS: dict[str, type[Reader]] = {
    **dict.fromkeys(ros_messages.IMAGE_TYPES, _Picture),
    "sensor_msgs/msg/LaserScan": _LaserScan,
    _CLOUD: _Cloud,
    "sensor_msgs/msg/Imu": _Inertial,
    "nav_msgs/msg/Odometry": _OdometryReader,
    _TRANSFORMS: _TransformReader,
    _TWIST_STAMPED: _TwistReader,
    **dict.fromkeys(POSE_TYPES, _Pose),
}

#: Types of messages that become sensors, and the kind of each.
UNDERSTOOD = {name: reader.kind for name, reader in _READERS.items()}


def new_reader(type_name: str, options: TopicOptions) -> Reader:
    """Return a reader of the messages of one topic."""
    return _READERS[type_name](options)
