"""Recordings of ROS 1 and ROS 2; no ROS is needed."""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from trailmark.errors import SourceError
from trailmark.frames import RGBD, DepthCamera, Image, Odometry, Payload, Record, SensorInfo, SensorOrigin
from trailmark.geometry import Pose2, Trajectory
from trailmark.sources import Reading, Readings, RecordedSource, ros_messages
from trailmark.sources.rgbd_pairs import RgbdPairs, StampedMessage
from trailmark.sources.ros_poses import LocalPlane, has_fix, pose_record
from trailmark_datasets.bagfile import BagFile, Message, open_bag
from trailmark_datasets.config import RosbagConfig
from trailmark_datasets.ros_poses import true_trajectory
from trailmark_datasets.ros_sensors import Mountings, frame_id_of, lens_beside, unread_topics
from trailmark_datasets.ros_topics import Choice, choose_topics
from trailmark_datasets.ros_transforms import expect_transform, planar_transforms

__all__ = ["Rosbag"]

logger = logging.getLogger(__name__)


class Rosbag(RecordedSource):
    """The understood topics of a recording; stamps are those of the headers."""

    config: RosbagConfig
    loads_ahead = True

    def __init__(self, config: RosbagConfig) -> None:
        super().__init__(config)
        self.reorder_s = config.reorder_s
        self._choices: tuple[Choice, ...] = ()
        self._pose_odom_start: dict[str, Pose2] = {}
        self._unread: Mapping[str, str] = {}
        self._origins: dict[str, SensorOrigin] = {}
        self._lasts_s: float | None = None

    def open_recording(self, name: str) -> Iterable[SensorInfo]:
        self._pose_odom_start = {}
        self._planes: dict[str, LocalPlane] = {}
        self._origins = {}
        infos: dict[str, SensorInfo] = {}
        with open_bag(self.config.path, self.config.distribution) as bag:
            self._lasts_s = bag.duration_s
            choices = choose_topics(self.config, bag.topics, str(self.config.path))
            mountings = Mountings(bag, self.config)
            for sensor in dict.fromkeys(choice.sensor for choice in choices):
                own = [choice for choice in choices if choice.sensor == sensor]
                try:
                    infos[sensor] = self._with_mounting(self._info(bag, own), own[0], mountings)
                except SourceError as error:
                    if own[0].is_named:
                        raise
                    logger.info("left out: %s", error)
        if not infos:
            raise SourceError(f"{self.config.path}: no topic could be read; name them in topics or rgbd")
        self._choices = tuple(choice for choice in choices if choice.sensor in infos)
        self._unread = unread_topics(bag, {choice.topic for choice in self._choices})
        return infos.values()

    def lasts_s(self) -> float | None:
        """Return the time from the first message to the last."""
        return self._lasts_s

    def unread(self) -> Mapping[str, str]:
        """Return the topics that are not read, with their types and what could be done."""
        return self._unread

    def origins(self) -> Mapping[str, SensorOrigin]:
        """Return the topics from which mountings and lenses come, by sensor."""
        return self._origins

    def _with_mounting(self, info: SensorInfo, choice: Choice, mountings: Mountings) -> SensorInfo:
        """Return a sensor with the mounting that the recording gives it, and note where its facts come from."""
        lens = ros_messages.info_topic(choice.topic) if info.calibration is not None else ""
        found = mountings.mounting_of(choice)
        if found is None:
            self._origins[info.name] = SensorOrigin(calibration=lens)
            return info
        pose, where = found
        self._origins[info.name] = SensorOrigin(where, lens)
        return replace(info, pose_base_sensor=pose)

    def _info(self, bag: BagFile, choices: list[Choice]) -> SensorInfo:
        """Return kind, size and rate of a sensor; of pictures by reading the first."""
        sensor, kind, topic = choices[0].sensor, choices[0].kind, choices[0].topic
        rate_hz = bag.rates_hz.get(topic)
        if choices[0].pair is not None:
            expect_transform(bag, [choice.topic for choice in choices], choices[0].pair)
            return SensorInfo(sensor, kind)
        if kind not in ("image", "rgbd"):
            return SensorInfo(sensor, kind, rate_hz=rate_hz)
        first = self._first(bag, choices)
        self.expect_form(sensor, first)
        lens = lens_beside(bag, topic)
        if isinstance(first, RGBD):
            height, width = first.bgr.shape[:2]
            is_registered = len({frame_id_of(bag, choice.topic) for choice in choices}) == 1
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
        moving = {topic: [one for one in own if one.pair is not None] for topic, own in by_topic.items()}
        pairs = {name: RgbdPairs(pair.max_difference_s) for name, pair in self.config.rgbd.items()}
        for message in bag.messages(by_topic):
            if isinstance(message, SourceError):
                yield message
                continue
            own = by_topic[message.topic]
            if moving[message.topic]:
                yield from self._transform_readings(message, moving[message.topic])
                if len(moving[message.topic]) == len(own):
                    continue  # a message of transforms has no stamp of its own
            try:
                stamp_s = self._stamp(message)
            except SourceError as error:
                yield error
                continue
            for choice in own:
                if choice.kind == "pose" and not has_fix(message.content):
                    self.counted[f"no_fix_{choice.sensor}"] += 1
                elif choice.kind == "rgbd":
                    yield from self._pair_pictures(choice, pairs[choice.sensor], message, stamp_s)
                else:
                    yield Reading(choice.sensor, stamp_s, message.where, partial(self._payload, choice, message))
        for name, pending in pairs.items():
            yield from (self._rgbd_reading(name, *pair) for pair in pending.flush())
            self.counted[f"unpaired_{name}"] = pending.unpaired

    def _transform_readings(self, message: Message, choices: list[Choice]) -> Readings:
        """Yield the odometry that a message of transforms holds."""
        for choice in choices:
            assert choice.pair is not None
            try:
                found = list(planar_transforms(message.content, choice.pair, message.where))
            except SourceError as error:
                yield error
            except (ValueError, AttributeError, TypeError) as error:
                yield SourceError(f"{message.where} cannot be used: {error}")
            else:
                for stamp_s, pose in found:
                    at_s = message.receive_s if self.config.stamps == "receive" else stamp_s
                    start = self._pose_odom_start.setdefault(choice.sensor, pose)
                    payload = Odometry(start.inverse() @ pose)
                    yield Reading(choice.sensor, at_s, message.where, partial(_same, payload))

    def _stamp(self, message: Message) -> float:
        if self.config.stamps == "receive":
            return message.receive_s
        return ros_messages.stamp_of(message.content, message.where)

    def _pair_pictures(self, choice: Choice, pairs: RgbdPairs, message: Message, stamp_s: float) -> Readings:
        picture = StampedMessage(stamp_s, message.where, message.content)
        is_depth = choice.topic == self.config.rgbd[choice.sensor].depth
        for colour, depth in pairs.push(picture, is_depth):
            yield self._rgbd_reading(choice.sensor, colour, depth)

    def _rgbd_reading(self, sensor: str, colour: StampedMessage, depth: StampedMessage) -> Reading:
        return Reading(sensor, colour.stamp_s, colour.where, partial(ros_messages.rgbd, colour, depth))

    def _payload(self, choice: Choice, message: Message) -> Payload:
        try:
            return self._payload_of(choice, message)
        except (ValueError, AttributeError, TypeError) as error:  # NaN in a pose, a field of another shape
            raise SourceError(f"{message.where} cannot be used: {error}") from error

    def _payload_of(self, choice: Choice, message: Message) -> Payload:
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


def _same(payload: Payload) -> Payload:
    return payload
