"""Readings of sensors as the messages that a robot of ROS 2 sends, and its commands as it takes them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from trailmark.commands import Command, Stop, Velocity
from trailmark.frames import Image, Imu, Odometry, Payload, Scan
from trailmark.geometry import Pose2, Twist2
from trailmark_ros2.driving import stamp_of
from trailmark_ros2.message_types import new_message

__all__ = ["TOPIC_ENDS", "TOPIC_TYPES", "reading_message", "velocity_of_twist"]

#: What is added to a sensor's name to make its topic, by the kind of the sensor; other kinds are not sent.
TOPIC_ENDS: Mapping[str, str] = {"image": "image_raw", "odometry": "odom", "scan": "scan", "imu": "imu"}
#: Types of those topics.
TOPIC_TYPES: Mapping[str, str] = {
    "image": "sensor_msgs/msg/Image",
    "odometry": "nav_msgs/msg/Odometry",
    "scan": "sensor_msgs/msg/LaserScan",
    "imu": "sensor_msgs/msg/Imu",
}

_STANDS = 1e-4
_ENCODINGS = {(2, "uint8"): "mono8", (2, "uint16"): "mono16", (3, "uint8"): "bgr8"}


def reading_message(payload: Payload, stamp_s: float, frame_id: str) -> Any:
    """Return a reading as a message; None for a payload that has none.

    Odometry is of ``odom`` to ``base_link``; one that knows its distance alone is not sent.
    """
    match payload:
        case Image():
            return _image(payload, _header(stamp_s, frame_id))
        case Odometry(pose_start_base=Pose2() as pose, twist=twist):
            return _odometry(pose, twist or Twist2(), _header(stamp_s, "odom"))
        case Scan():
            return _scan(payload, _header(stamp_s, frame_id))
        case Imu():
            return _imu(payload, _header(stamp_s, frame_id))
    return None


def velocity_of_twist(twist: Any) -> Command:
    """Return a Twist as a command; one that is (nearly) zero, or no number, is a `Stop`."""
    speeds = tuple(float(value) for value in (twist.linear.x, twist.linear.y, twist.angular.z))
    if not all(math.isfinite(speed) for speed in speeds) or max(abs(speed) for speed in speeds) < _STANDS:
        return Stop("zero velocity")
    return Velocity(*speeds)


def _header(stamp_s: float, frame_id: str) -> Any:
    return new_message("std_msgs/msg/Header", {"stamp": stamp_of(stamp_s), "frame_id": frame_id})


def _image(image: Image, header: Any) -> Any:
    pixels = np.ascontiguousarray(image.pixels)
    height, width = pixels.shape[:2]
    fields = {"header": header, "height": height, "width": width, "step": pixels.nbytes // height}
    encoding = _ENCODINGS[pixels.ndim, pixels.dtype.name]
    data = pixels.view(np.uint8).ravel()
    return new_message("sensor_msgs/msg/Image", fields | {"encoding": encoding, "data": data})


def _odometry(pose: Pose2, twist: Twist2, header: Any) -> Any:
    vector = "geometry_msgs/msg/Vector3"
    half = pose.theta / 2.0
    turn = new_message("geometry_msgs/msg/Quaternion", {"z": math.sin(half), "w": math.cos(half)})
    place = new_message("geometry_msgs/msg/Point", {"x": pose.x, "y": pose.y})
    linear = new_message(vector, {"x": float(twist.forward_mps), "y": float(twist.left_mps)})
    velocity = {"linear": linear, "angular": new_message(vector, {"z": float(twist.yaw_radps)})}
    known = new_message("geometry_msgs/msg/Pose", {"position": place, "orientation": turn})
    return new_message(
        "nav_msgs/msg/Odometry",
        {
            "header": header,
            "child_frame_id": "base_link",
            "pose": new_message("geometry_msgs/msg/PoseWithCovariance", {"pose": known}),
            "twist": new_message(
                "geometry_msgs/msg/TwistWithCovariance", {"twist": new_message("geometry_msgs/msg/Twist", velocity)}
            ),
        },
    )


def _scan(scan: Scan, header: Any) -> Any:
    most_m = scan.range_max_m if math.isfinite(scan.range_max_m) else 1e3
    fields = {
        "header": header,
        "angle_min": scan.angle_min_rad,
        "angle_max": scan.angle_min_rad + scan.angle_step_rad * (len(scan.ranges_m) - 1),
        "angle_increment": scan.angle_step_rad,
        "range_min": scan.range_min_m,
        "range_max": most_m,
        "ranges": np.asarray(np.nan_to_num(scan.ranges_m, nan=np.inf), dtype=np.float32),  # nothing came back: REP-117
    }
    return new_message("sensor_msgs/msg/LaserScan", fields)


def _imu(imu: Imu, header: Any) -> Any:
    def vector(values: Any) -> Any:
        return new_message("geometry_msgs/msg/Vector3", dict(zip("xyz", map(float, values), strict=True)))

    not_measured = np.zeros(9)
    not_measured[0] = -1.0
    fields = {"header": header, "angular_velocity": vector(imu.angular_velocity_radps)}
    if imu.linear_acceleration_mps2 is None:
        fields["linear_acceleration_covariance"] = not_measured
    else:
        fields["linear_acceleration"] = vector(imu.linear_acceleration_mps2)
    if imu.quat_xyzw is None:
        fields["orientation_covariance"] = not_measured
    else:
        turn = dict(zip("xyzw", map(float, imu.quat_xyzw), strict=True))
        fields["orientation"] = new_message("geometry_msgs/msg/Quaternion", turn)
    return new_message("sensor_msgs/msg/Imu", fields)
