"""Absolute poses in the ROS messages of a recording, as ground truth."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import SourceError
from trailmark.geometry import Pose2, Trajectory
from trailmark.sources.ros_messages import planar_pose, stamp_of
from trailmark.sources.ros_poses import POSE_TYPES, SATELLITE, LocalPlane, has_fix, pose_record
from trailmark_datasets.bagfile import BagFile, Message
from trailmark_datasets.ros_transforms import TRANSFORM_TYPES, frame_pair, planar_transforms

__all__ = ["TRUTH_TYPES", "true_trajectory"]

#: Types of messages that may be the truth.
TRUTH_TYPES = (*POSE_TYPES, "nav_msgs/msg/Odometry", *TRANSFORM_TYPES)


def true_trajectory(bag: BagFile, truth: str, *, stamps: str) -> Trajectory:
    """Return the poses of a topic, or of a transform ``PARENT -> CHILD``, as ground truth.

    Satellite fixes tell no heading: the way they make does, between fixes 0.5 m apart.

    Raises
    ------
    SourceError
        If there is no such topic or transform, or its messages cannot be poses.
    """
    pair = frame_pair(truth)
    topics = [name for name, kind in bag.topics.items() if kind in TRANSFORM_TYPES] if pair else [truth]
    if not topics or bag.topics.get(topics[0]) not in TRUTH_TYPES:
        known = ", ".join(name for name, kind in sorted(bag.topics.items()) if kind in TRUTH_TYPES) or "none"
        raise SourceError(f"{bag.path}: ground_truth_topic {truth!r} holds no poses; topics that do: {known}")
    poses: dict[float, Pose2] = {}
    plane = LocalPlane()
    for message in bag.messages(topics):
        if isinstance(message, SourceError):
            raise message
        try:
            found = list(
                planar_transforms(message.content, pair, message.where) if pair else _pose_of(message, plane, stamps)
            )
        except (ValueError, AttributeError) as error:
            raise SourceError(f"{message.where} cannot be the truth: {error}") from error
        for stamp_s, pose in found:
            poses.setdefault(stamp_s, pose)
    if not poses:
        raise SourceError(f"{bag.path}: nothing of the ground truth {truth!r} is there")
    stamped = sorted(poses.items())
    if pair is None and bag.topics[truth] == SATELLITE:
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
