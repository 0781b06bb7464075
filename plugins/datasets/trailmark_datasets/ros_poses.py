"""Absolute poses in ROS messages: stamped poses, satellite fixes, transforms; as readings and as ground truth."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import SourceError
from trailmark.frames import Record
from trailmark.geometry import Pose2, Trajectory
from trailmark_datasets.bagfile import BagFile, Message
from trailmark_datasets.ros_messages import planar_pose, stamp_of

__all__ = ["POSE_TYPES", "TRUTH_TYPES", "LocalPlane", "has_fix", "pose_record", "true_trajectory"]

_SATELLITE = "sensor_msgs/msg/NavSatFix"
_TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

#: Types of messages that hold an absolute pose; they are read where the config names their topic.
POSE_TYPES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped", _SATELLITE)
#: Types of messages that may be the truth.
TRUTH_TYPES = (*POSE_TYPES, "nav_msgs/msg/Odometry", *_TRANSFORMS)

# WGS 84
_EQUATOR_M, _ECCENTRICITY_SQUARED = 6_378_137.0, 6.694_379_990_14e-3
_PLANAR = np.ix_((0, 1, 5), (0, 1, 5))  # x, y and yaw of the six of a covariance


@dataclass(slots=True)
class LocalPlane:
    """The plane that touches the ellipsoid of WGS 84 at the first place it is asked about: x east, y north.

    Its scale is that of the first place: 10 km away distances are short by about one in a thousand.
    """

    origin_deg: tuple[float, float] | None = None

    def place(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Return x and y [m] of a place."""
        if self.origin_deg is None:
            self.origin_deg = (latitude_deg, longitude_deg)
        latitude_0, longitude_0 = self.origin_deg
        sine = math.sin(math.radians(latitude_0))
        flattened = 1.0 - _ECCENTRICITY_SQUARED * sine * sine
        east_radius_m = _EQUATOR_M / math.sqrt(flattened) * math.cos(math.radians(latitude_0))
        north_radius_m = _EQUATOR_M * (1.0 - _ECCENTRICITY_SQUARED) / flattened**1.5
        turn_deg = math.remainder(longitude_deg - longitude_0, 360.0)
        return east_radius_m * math.radians(turn_deg), north_radius_m * math.radians(latitude_deg - latitude_0)


def has_fix(message: Any) -> bool:
    """Return whether a message knows a place: a satellite receiver may not."""
    if not hasattr(message, "latitude"):
        return True
    return bool(message.status.status >= 0 and math.isfinite(message.latitude) and math.isfinite(message.longitude))


def pose_record(message: Any, plane: LocalPlane) -> Record:
    """Return an absolute pose as a record of kind ``pose``.

    Returns
    -------
    Record
        ``pose``: (3,) x, y [m] and heading [rad] of what carries the sensor. ``covariance``: (3, 3) of them, infinite
        where nothing is known of a number, and NaN where the message does not say how exact it is.

    Raises
    ------
    ValueError
        If a number is missing, or an orientation is none.
    """
    if hasattr(message, "latitude"):
        return _satellite_record(message, plane)
    has_covariance = hasattr(message.pose, "covariance")
    pose = planar_pose(message.pose.pose if has_covariance else message.pose)
    covariance = np.full((3, 3), np.nan)
    if has_covariance:
        told = np.asarray(message.pose.covariance, float).reshape(6, 6)[_PLANAR]
        covariance = told if np.all(np.diag(told) > 0.0) else covariance
    return Record({"pose": pose.array(), "covariance": covariance})


def _satellite_record(message: Any, plane: LocalPlane) -> Record:
    x, y = plane.place(float(message.latitude), float(message.longitude))
    covariance = np.diag([np.nan, np.nan, np.inf])  # a receiver does not know where it heads
    told = np.asarray(message.position_covariance, float).reshape(3, 3)[:2, :2]
    if message.position_covariance_type > 0 and np.all(np.diag(told) > 0.0):
        covariance[:2, :2] = told
    return Record({"pose": np.array([x, y, 0.0]), "covariance": covariance})


def true_trajectory(bag: BagFile, truth: str, *, stamps: str) -> Trajectory:
    """Return the poses of a topic, or of a transform ``PARENT -> CHILD``, as ground truth.

    Satellite fixes tell no heading: the way they make does, between fixes 0.5 m apart.

    Raises
    ------
    SourceError
        If there is no such topic or transform, or its messages cannot be poses.
    """
    parent, arrow, child = (part.strip() for part in truth.partition("->"))
    topics = [name for name, kind in bag.topics.items() if kind in _TRANSFORMS] if arrow else [truth]
    if not topics or bag.topics.get(topics[0]) not in TRUTH_TYPES:
        known = ", ".join(name for name, kind in sorted(bag.topics.items()) if kind in TRUTH_TYPES) or "none"
        raise SourceError(f"{bag.path}: ground_truth_topic {truth!r} holds no poses; topics that do: {known}")
    poses: dict[float, Pose2] = {}
    plane = LocalPlane()
    for message in bag.messages(topics):
        if isinstance(message, SourceError):
            raise message
        try:
            found = list(_transforms(message, parent, child) if arrow else _pose_of(message, plane, stamps))
        except (ValueError, AttributeError) as error:
            raise SourceError(f"{message.where} cannot be the truth: {error}") from error
        for stamp_s, pose in found:
            poses.setdefault(stamp_s, pose)
    if not poses:
        raise SourceError(f"{bag.path}: nothing of the ground truth {truth!r} is there")
    stamped = sorted(poses.items())
    if not arrow and bag.topics[truth] == _SATELLITE:
        stamped = _headed_along_the_way(stamped)
    return Trajectory.from_poses(stamped)


def _pose_of(message: Message, plane: LocalPlane, stamps: str) -> Iterator[tuple[float, Pose2]]:
    content = message.content
    stamp_s = message.receive_s if stamps == "receive" else stamp_of(content, message.where)
    if hasattr(content, "twist"):
        yield stamp_s, planar_pose(content.pose.pose)
        return
    if has_fix(content):
        pose = pose_record(content, plane).arrays["pose"]
        yield stamp_s, Pose2(*(float(value) for value in pose))


def _transforms(message: Message, parent: str, child: str) -> Iterator[tuple[float, Pose2]]:
    for transform in message.content.transforms:
        names = (transform.header.frame_id.lstrip("/"), transform.child_frame_id.lstrip("/"))
        if names == (parent.lstrip("/"), child.lstrip("/")):
            move = transform.transform
            pose = planar_pose(_TransformAsPose(move.translation, move.rotation))
            yield stamp_of(transform, message.where), pose


@dataclass(frozen=True, slots=True)
class _TransformAsPose:
    position: Any
    orientation: Any


def _headed_along_the_way(stamped: list[tuple[float, Pose2]], apart_m: float = 0.5) -> list[tuple[float, Pose2]]:
    """Give each place the direction from the last place `apart_m` before it; the first ones that of the first such."""
    places: Floats = np.array([pose.array() for _, pose in stamped])
    heading, last, headings = None, 0, np.full(len(places), np.nan)
    for index, place in enumerate(places):
        dx, dy = place[:2] - places[last, :2]
        if math.hypot(dx, dy) >= apart_m:
            heading, last = math.atan2(dy, dx), index
        headings[index] = np.nan if heading is None else heading
    known = headings[~np.isnan(headings)]
    headings[np.isnan(headings)] = known[0] if len(known) else 0.0
    return [(stamp_s, Pose2(pose.x, pose.y, float(theta))) for (stamp_s, pose), theta in zip(stamped, headings)]
