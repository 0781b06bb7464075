"""What a recording of ROS says of its sensors besides their readings: where they are mounted, and their lenses."""

from __future__ import annotations

import logging
import math
from typing import Any

from trailmark.errors import SourceError
from trailmark.frames import Pinhole
from trailmark.geometry import Pose3
from trailmark.sources import ros_messages
from trailmark.sources.frame_tree import FrameTree, describe_mounting, is_optical
from trailmark.sources.ros_poses import POSE_TYPES, SATELLITE
from trailmark_datasets.bagfile import BagFile, Message
from trailmark_datasets.config import RosbagConfig
from trailmark_datasets.ros_poses import TRUTH_TYPES
from trailmark_datasets.ros_topics import Choice
from trailmark_datasets.ros_transforms import base_frame_of, read_static_tree

__all__ = ["CAMERA_INFO", "Mountings", "frame_id_of", "lens_beside", "unread_topics"]

logger = logging.getLogger(__name__)

CAMERA_INFO = "sensor_msgs/msg/CameraInfo"

_LEVEL_RAD = math.radians(10.0)


class Mountings:
    """The mountings that ``/tf_static`` gives.

    Parameters
    ----------
    bag : BagFile
        The recording, open.
    config : RosbagConfig
        Its `tf_static` and `base_frame`.

    Raises
    ------
    SourceError
        If a message cannot be decoded, or `base_frame` is not there.
    """

    def __init__(self, bag: BagFile, config: RosbagConfig) -> None:
        self._bag, self._where = bag, str(config.path)
        self._tree = read_static_tree(bag) if config.tf_static else FrameTree({})
        self._base = base_frame_of(self._tree, config.base_frame, self._where) if config.tf_static else None
        if self._tree.parents and self._base is None:
            logger.warning(
                "%s: none of the frames in /tf_static is called base_link, so no mounting is taken from it;"
                " say base_frame, one of %s",
                self._where,
                ", ".join(sorted(self._tree.frames)),
            )

    def mounting_of(self, choice: Choice) -> tuple[Pose3, str] | None:
        """Return `pose_base_sensor` of a topic's sensor and where it was found; None where the recording says nothing.

        Raises
        ------
        SourceError
            If a transform on the way has no orientation.
        """
        type_of_message = self._bag.topics[choice.topic]
        is_carried = choice.kind in ("image", "rgbd", "scan", "imu") or type_of_message == SATELLITE
        if self._base is None or not is_carried:
            return None
        frame = frame_id_of(self._bag, choice.topic)
        if not frame:  # its sender does not say
            return None
        try:
            pose = self._tree.mounting(self._base, frame, is_optical=is_optical(choice.kind, frame))
        except ValueError as error:
            raise SourceError(
                f"{self._where}: {error}; set tf_static: false and say the mounting in the config"
            ) from error
        if pose is None:
            logger.warning(
                "%s: nothing in /tf_static leads from %s to %r, the frame of %s: its mounting is unknown",
                self._where,
                self._base,
                frame,
                choice.topic,
            )
            return None
        if choice.kind == "scan" and max(abs(pose.roll), abs(pose.pitch)) > _LEVEL_RAD:
            logger.warning(
                "%s: the laser of %s is not level (%s): what works in the plane takes x, y and yaw of it alone",
                self._where,
                choice.topic,
                describe_mounting(pose),
            )
        return pose, f"/tf_static ({self._base} -> {frame}: {describe_mounting(pose)})"


def lens_beside(bag: BagFile, topic: str) -> Pinhole | None:
    """Return the lens by the CameraInfo beside an image topic."""
    beside = ros_messages.info_topic(topic)
    if bag.topics.get(beside) != CAMERA_INFO:
        return None
    info = _first_content(bag, beside)
    return None if info is None else ros_messages.lens(info, is_rectified="rect" in topic)


def frame_id_of(bag: BagFile, topic: str) -> str:
    """Return the frame that the first readable message of a topic names."""
    content = _first_content(bag, topic)
    return "" if content is None else str(content.header.frame_id).lstrip("/")


def _first_content(bag: BagFile, topic: str) -> Any:
    """Return the first readable message of a topic, or None."""
    found = (message.content for message in bag.messages([topic]) if isinstance(message, Message))
    return next(found, None)


def unread_topics(bag: BagFile, read: set[str]) -> dict[str, str]:
    """Return type and remark of the topics that become no sensor; CameraInfo is read beside its pictures."""
    rest = {topic: kind for topic, kind in sorted(bag.topics.items()) if topic not in read and kind != CAMERA_INFO}
    return {topic: f"{kind}: {_remark(topic, kind)}" for topic, kind in rest.items()}


def _remark(topic: str, kind: str) -> str:
    if kind in POSE_TYPES:
        return "read when topics names it, or as ground_truth_topic"
    if topic.endswith("tf_static"):
        return "read for the mountings alone"
    if kind in TRUTH_TYPES:
        return 'read as ground_truth_topic, and a transform as odometry: topics: {wheels: "odom -> base_link"}'
    return "named in topics it would be read" if kind in ros_messages.KINDS else "not understood"
