"""Recordings of ROS 1 and ROS 2; no ROS is needed."""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

from trailmark.errors import SourceError
from trailmark.frames import RGBD, DepthCamera, Image, Payload, Pinhole, Record, SensorInfo
from trailmark.geometry import Pose2, Trajectory
from trailmark.sources import Reading, Readings, RecordedSource, ros_messages
from trailmark.sources.pictures import as_payload_pixels
from trailmark.sources.rgbd_pairs import RgbdPairs, StampedMessage
from trailmark_datasets.bagfile import BagFile, Message, open_bag
from trailmark_datasets.config import RosbagConfig
from trailmark_datasets.depth import depth_in_metres
from trailmark_datasets.ros_poses import POSE_TYPES, TRUTH_TYPES, LocalPlane, has_fix, pose_record, true_trajectory
from trailmark_datasets.ros_topics import Choice, choose_topics, info_topic

__all__ = ["Rosbag"]

logger = logging.getLogger(__name__)

_CAMERA_INFO = "sensor_msgs/msg/CameraInfo"


class Rosbag(RecordedSource):
    """The understood topics of a recording; stamps are those of the headers."""

    config: RosbagConfig

    def __init__(self, config: RosbagConfig) -> None:
        super().__init__(config)
        self.reorder_s = config.reorder_s
        self._choices: tuple[Choice, ...] = ()
        self._pose_odom_start: dict[str, Pose2] = {}
        self._unread: Mapping[str, str] = {}

    def open_recording(self, name: str) -> Iterable[SensorInfo]:
        self._pose_odom_start = {}
        self._planes: dict[str, LocalPlane] = {}
        infos: dict[str, SensorInfo] = {}
        with open_bag(self.config.path, self.config.distribution) as bag:
            choices = choose_topics(self.config, bag.topics, str(self.config.path))
            for sensor in dict.fromkeys(choice.sensor for choice in choices):
                own = [choice for choice in choices if choice.sensor == sensor]
                try:
                    infos[sensor] = self._info(bag, own)
                except SourceError as error:
                    if own[0].is_named:
                        raise
                    logger.info("left out: %s", error)
        if not infos:
            raise SourceError(f"{self.config.path}: no topic could be read; name them in topics or rgbd")
        self._choices = tuple(choice for choice in choices if choice.sensor in infos)
        self._unread = _unread_topics(bag, {choice.topic for choice in self._choices})
        return infos.values()

    def unread(self) -> Mapping[str, str]:
        """Return the topics that are not read, with their types and what could be done."""
        return self._unread

    def _info(self, bag: BagFile, choices: list[Choice]) -> SensorInfo:
        """Tell what a sensor is; for pictures by looking at the first."""
        sensor, kind, topic = choices[0].sensor, choices[0].kind, choices[0].topic
        rate_hz = bag.rates_hz.get(topic)
        if kind not in ("image", "rgbd"):
            return SensorInfo(sensor, kind, rate_hz=rate_hz)
        first = self._first(bag, choices)
        self.expect_form(sensor, first)
        lens = _lens_beside(bag, topic)
        if isinstance(first, RGBD):
            height, width = first.bgr.shape[:2]
            is_registered = len({_frame_id(bag, choice.topic) for choice in choices}) == 1
            calibration = DepthCamera(lens) if lens is not None and is_registered else None
            return SensorInfo(sensor, kind, (width, height), rate_hz, calibration=calibration)
        return SensorInfo(sensor, kind, first.size, rate_hz, calibration=lens)

    def _first(self, bag: BagFile, choices: list[Choice]) -> Image | RGBD:
        """Return the first picture; with ``on_bad_frame: skip`` the first readable one."""
        errors: list[SourceError] = []
        for reading in self._readings_of(bag, choices):
            try:
                if isinstance(reading, SourceError):
                    raise reading
                payload = reading.load()
                if isinstance(payload, Image | RGBD):
                    return payload
            except SourceError as error:
                errors.append(error)
                if self.config.on_bad_frame == "error":
                    break
        if errors:
            raise errors[0]
        raise SourceError(f"{self.config.path}: {choices[0].sensor!r} has no colour and depth that make a pair")

    def readings(self) -> Readings:
        with open_bag(self.config.path, self.config.distribution) as bag:
            yield from self._readings_of(bag, self._choices)

    def _readings_of(self, bag: BagFile, choices: Iterable[Choice]) -> Readings:
        by_topic: dict[str, list[Choice]] = defaultdict(list)
        for choice in choices:
            by_topic[choice.topic].append(choice)
        pairs = {name: RgbdPairs(pair.max_difference_s) for name, pair in self.config.rgbd.items()}
        for message in bag.messages(by_topic):
            if isinstance(message, SourceError):
                yield message
                continue
            try:
                stamp_s = self._stamp(message)
            except SourceError as error:
                yield error
                continue
            for choice in by_topic[message.topic]:
                if choice.kind == "pose" and not has_fix(message.content):
                    self.counted[f"no_fix_{choice.sensor}"] += 1
                elif choice.kind == "rgbd":
                    yield from self._paired(choice, pairs[choice.sensor], message, stamp_s)
                else:
                    yield Reading(choice.sensor, stamp_s, message.where, partial(self._payload, choice, message))
        for name, pending in pairs.items():
            yield from (self._rgbd_reading(name, *pair) for pair in pending.flush())
            self.counted[f"unpaired_{name}"] = pending.unpaired

    def _stamp(self, message: Message) -> float:
        if self.config.stamps == "receive":
            return message.receive_s
        return ros_messages.stamp_of(message.content, message.where)

    def _paired(self, choice: Choice, pairs: RgbdPairs, message: Message, stamp_s: float) -> Readings:
        picture = StampedMessage(stamp_s, message.where, message.content)
        is_depth = choice.topic == self.config.rgbd[choice.sensor].depth
        for colour, depth in pairs.push(picture, is_depth):
            yield self._rgbd_reading(choice.sensor, colour, depth)

    def _rgbd_reading(self, sensor: str, colour: StampedMessage, depth: StampedMessage) -> Reading:
        return Reading(sensor, colour.stamp_s, colour.where, partial(_rgbd, colour, depth))

    def _payload(self, choice: Choice, message: Message) -> Payload:
        try:
            return self._converted(choice, message)
        except (ValueError, AttributeError, TypeError) as error:  # NaN in a pose, a field of another shape
            raise SourceError(f"{message.where} cannot be used: {error}") from error

    def _converted(self, choice: Choice, message: Message) -> Payload:
        content = message.content
        if choice.kind == "image":
            return ros_messages.image(content, message.where)
        if choice.kind == "scan":
            return ros_messages.scan(content)
        if choice.kind == "imu":
            return ros_messages.imu(content)
        if choice.kind == "pose":
            return self._pose(choice, content)
        pose_odom_base = ros_messages.planar_pose(content.pose.pose)
        return ros_messages.odometry(content, self._pose_odom_start.setdefault(choice.sensor, pose_odom_base))

    def _pose(self, choice: Choice, content: Any) -> Record:
        return pose_record(content, self._planes.setdefault(choice.sensor, LocalPlane()))

    def ground_truth(self) -> Trajectory | None:
        """Return the poses of the topic that the config names as the truth."""
        if self.config.ground_truth_topic is None:
            return None
        with open_bag(self.config.path, self.config.distribution) as bag:
            return true_trajectory(bag, self.config.ground_truth_topic, stamps=self.config.stamps)


def _rgbd(colour: StampedMessage, depth: StampedMessage) -> RGBD:
    bgr = as_payload_pixels(ros_messages.pixels(colour.message, colour.where), colour.where, grey=False)
    raw = ros_messages.pixels(depth.message, depth.where)
    values_per_metre = 1.0 if raw.dtype.kind == "f" else 1000.0  # 32FC1 metres, 16UC1 millimetres: REP-118
    return RGBD(bgr, depth_in_metres(raw, values_per_metre, depth.where))


def _lens_beside(bag: BagFile, topic: str) -> Pinhole | None:
    """Return the lens that the CameraInfo beside an image topic tells."""
    beside = info_topic(topic)
    if bag.topics.get(beside) != _CAMERA_INFO:
        return None
    info = _first_content(bag, beside)
    return None if info is None else ros_messages.lens(info, is_rectified="rect" in topic)


def _unread_topics(bag: BagFile, read: set[str]) -> dict[str, str]:
    """Return type and remark of the topics that become no sensor; CameraInfo is read beside its pictures."""
    rest = {topic: kind for topic, kind in sorted(bag.topics.items()) if topic not in read and kind != _CAMERA_INFO}
    return {topic: f"{kind}: {_remark(kind)}" for topic, kind in rest.items()}


def _remark(kind: str) -> str:
    if kind in POSE_TYPES:
        return "read when topics names it, or as ground_truth_topic"
    if kind in TRUTH_TYPES:
        return "read as ground_truth_topic"
    return "named in topics it would be read" if kind in ros_messages.KINDS else "not understood"


def _frame_id(bag: BagFile, topic: str) -> str:
    content = _first_content(bag, topic)
    return "" if content is None else str(content.header.frame_id)


def _first_content(bag: BagFile, topic: str) -> Any:
    """Return the first readable message of a topic, or None."""
    found = (message.content for message in bag.messages([topic]) if isinstance(message, Message))
    return next(found, None)
