"""Beliefs as messages of ROS 2."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Belief
from trailmark.geometry import Pose2
from trailmark_ros2.driving import stamp_of
from trailmark_ros2.message_types import new_message

__all__ = [
    "covariance_of_six",
    "diagnostics_message",
    "odometry_message",
    "path_message",
    "pose_message",
    "transform_message",
]

_PLANAR = np.ix_((0, 1, 5), (0, 1, 5))
# Height, roll and pitch of a robot on a floor are known: as AMCL and robot_localization have it in two dimensions.
_FLAT = 1e-9
_UNKNOWN_VARIANCE = 1e6
_UNKNOWN = np.diag([_UNKNOWN_VARIANCE, _UNKNOWN_VARIANCE, _FLAT, _FLAT, _FLAT, _UNKNOWN_VARIANCE])
_LEVELS = {"ok": 0, "warn": 1, "error": 2}


def covariance_of_six(covariance: Floats | None) -> Floats:
    """Return a covariance of x, y, z, roll, pitch, yaw, (36,) row-major; where nothing is known it is huge."""
    six = _UNKNOWN.copy()
    if covariance is not None:
        six[_PLANAR] = _bounded(np.asarray(covariance, dtype=np.float64))
    return six.ravel()


def _bounded(covariance: Floats) -> Floats:
    """Return a covariance with variances of at most the unknown's; correlations stay, so that it is one still."""
    if np.isfinite(covariance).all() and covariance.diagonal().max() <= _UNKNOWN_VARIANCE:
        return covariance
    is_known = np.isfinite(np.diag(covariance))
    variances = np.where(is_known, np.diag(covariance), _UNKNOWN_VARIANCE)
    shrink = np.sqrt(np.minimum(1.0, _UNKNOWN_VARIANCE / np.maximum(variances, _FLAT)))
    both = np.outer(is_known, is_known)
    bounded: Floats = np.where(both, covariance, 0.0) * np.outer(shrink, shrink)
    bounded[np.diag_indices(3)] = np.minimum(variances, _UNKNOWN_VARIANCE)
    return bounded


def header(stamp_s: float, frame_id: str) -> Any:
    """Return a header."""
    return new_message("std_msgs/msg/Header", {"stamp": stamp_of(stamp_s), "frame_id": frame_id})


def _pose(pose: Pose2) -> Any:
    point = new_message("geometry_msgs/msg/Point", {"x": pose.x, "y": pose.y})
    return new_message("geometry_msgs/msg/Pose", {"position": point, "orientation": _quaternion(pose.theta)})


def _quaternion(heading_rad: float) -> Any:
    half = heading_rad / 2.0
    return new_message("geometry_msgs/msg/Quaternion", {"z": math.sin(half), "w": math.cos(half)})


def _pose_with_covariance(belief: Belief) -> Any:
    assert belief.pose_map_base is not None
    fields = {"pose": _pose(belief.pose_map_base), "covariance": covariance_of_six(belief.covariance)}
    return new_message("geometry_msgs/msg/PoseWithCovariance", fields)


def pose_message(belief: Belief, map_frame: str) -> Any:
    """Return a belief that knows its pose as PoseWithCovarianceStamped."""
    fields = {"header": header(belief.stamp_s, map_frame), "pose": _pose_with_covariance(belief)}
    return new_message("geometry_msgs/msg/PoseWithCovarianceStamped", fields)


def odometry_message(belief: Belief, map_frame: str, base_frame: str) -> Any:
    """Return a belief that knows its pose as Odometry in the map; its twist is in base axes."""
    vector, twist = "geometry_msgs/msg/Vector3", belief.twist
    velocity = new_message(
        "geometry_msgs/msg/Twist",
        {
            "linear": new_message(vector, {"x": float(twist.forward_mps), "y": float(twist.left_mps)}),
            "angular": new_message(vector, {"z": float(twist.yaw_radps)}),
        },
    )
    unknown = covariance_of_six(None)  # an estimator says how sure it is of the pose, not of the velocity
    return new_message(
        "nav_msgs/msg/Odometry",
        {
            "header": header(belief.stamp_s, map_frame),
            "child_frame_id": base_frame,
            "pose": _pose_with_covariance(belief),
            "twist": new_message("geometry_msgs/msg/TwistWithCovariance", {"twist": velocity, "covariance": unknown}),
        },
    )


def path_message(poses: Sequence[Pose2], stamp_s: float, map_frame: str) -> Any:
    """Return poses as Path, all of one stamp."""
    head = header(stamp_s, map_frame)
    stamped = [new_message("geometry_msgs/msg/PoseStamped", {"header": head, "pose": _pose(pose)}) for pose in poses]
    return new_message("nav_msgs/msg/Path", {"header": head, "poses": stamped})


def transform_message(pose_parent_child: Pose2, stamp_s: float, parent: str, child: str) -> Any:
    """Return a transform as TFMessage: it takes coordinates of the child to those of the parent."""
    pose = pose_parent_child
    translation = new_message("geometry_msgs/msg/Vector3", {"x": pose.x, "y": pose.y})
    transform = new_message(
        "geometry_msgs/msg/Transform", {"translation": translation, "rotation": _quaternion(pose.theta)}
    )
    stamped = new_message(
        "geometry_msgs/msg/TransformStamped",
        {"header": header(stamp_s, parent), "child_frame_id": child, "transform": transform},
    )
    return new_message("tf2_msgs/msg/TFMessage", {"transforms": [stamped]})


def diagnostics_message(stamp_s: float, name: str, level: str, values: Mapping[str, str], *, summary: str) -> Any:
    """Return one status as DiagnosticArray; the level is ok, warn or error."""
    pairs = [new_message("diagnostic_msgs/msg/KeyValue", {"key": key, "value": value}) for key, value in values.items()]
    status = new_message(
        "diagnostic_msgs/msg/DiagnosticStatus",
        {"level": _LEVELS[level], "name": name, "message": summary, "hardware_id": "trailmark", "values": pairs},
    )
    return new_message("diagnostic_msgs/msg/DiagnosticArray", {"header": header(stamp_s, ""), "status": [status]})
