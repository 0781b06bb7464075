"""A robot of ROS 2 as a source that can be driven."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from trailmark.commands import Command, Stop
from trailmark.errors import SourceError
from trailmark.frames import DepthCamera, Frame, Pinhole, SensorInfo, SensorOrigin
from trailmark.geometry import Pose3
from trailmark.interfaces import Drivable, Session
from trailmark.sources import ros_messages
from trailmark.sources.frame_tree import FrameTree
from trailmark_ros2 import dds
from trailmark_ros2.config import Ros2SourceConfig
from trailmark_ros2.driving import COMMAND_TYPES, RobotDriver, accepted_commands, command_message
from trailmark_ros2.feeds import DEPTH, DepthPairing, TopicFeed
from trailmark_ros2.listening import ListenerWatch
from trailmark_ros2.meeting import MetTopic, Patience, first_message, meet_writers
from trailmark_ros2.mountings import mounting_of, static_tree, tell_of_frames
from trailmark_ros2.readings import new_reader
from trailmark_ros2.resets import refuse_a_reset
from trailmark_ros2.stamping import Stamper

__all__ = ["Ros2Source"]

logger = logging.getLogger(__name__)

_CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
_TRANSFORMS = "tf2_msgs/msg/TFMessage"
_POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
_PLANAR = np.ix_((0, 1, 5), (0, 1, 5))  # x, y and yaw of the six of a covariance

# Calibrations and mountings that do not come so soon are not sent [s].
_BESIDE_S = 1.0
_LOOK_EVERY_S = 0.5
_LONGEST_WAIT_S = 0.1
# How long `close` waits for messages that are being taken [s].
_RELEASE_S = 2.0


class Ros2Source(Drivable):
    """Topics of a robot as sensors, and its command topic.

    What a topic is, its writer says; the sizes of pictures, their first message; lenses the CameraInfo beside them, and
    mountings /tf_static. Without `command` it drives itself as far as a run can see, and nothing is ever sent to it.
    """

    config: Ros2SourceConfig
    is_live: ClassVar[bool] = True

    def __init__(self, config: Ros2SourceConfig) -> None:
        super().__init__(config)
        self._sensors: Mapping[str, SensorInfo] = MappingProxyType({})
        self._origins: dict[str, SensorOrigin] = {}
        self._feeds: list[TopicFeed] = []
        self._network: dds.Network | None = None
        self._driver: RobotDriver | None = None
        self._listener: ListenerWatch | None = None
        self._told: dds.Subscription | None = None
        self._closed = threading.Event()
        self._busy = threading.Lock()  # the network must not go while messages are being taken
        self._session = Session()
        self._has_told_frame = False
        self._has_topic = config.command is not None
        self.drives_itself = not self._has_topic

    # --- life ------------------------------------------------------------------------------------------------------

    def start(self, session: Session) -> None:
        """Find the topics, and wait for the first picture of each camera.

        Raises
        ------
        SourceError
            If a topic stays away for `start_timeout_s`, or is of another type.
        """
        self.close()
        self._closed, self._session, self._has_told_frame = threading.Event(), session, False
        config = self.config
        self.drives_itself = not self._has_topic or session.mode == "teach"  # a person drives while teaching
        domain = dds.default_domain() if config.domain is None else config.domain
        self._network = network = dds.Network(domain, config.interface)
        try:
            self._meet(network, Patience(self._closed, config.silence_s, config.start_timeout_s))
        except BaseException:
            self.close()
            raise
        if config.initial_pose is not None:
            self._told = network.subscription(config.initial_pose, _POSE, dds.Quality())
        if config.command is not None:
            type_name = COMMAND_TYPES[config.command_type]
            publisher = network.publisher(config.command, type_name, dds.Quality())
            if not self.drives_itself:
                self._listener = ListenerWatch(publisher, config.command, type_name, config.silence_s)
            message_of = partial(command_message, kind=config.command_type, wheelbase_m=config.wheelbase_m)
            self._driver = RobotDriver(publisher, message_of, config.watchdog_s)

    def close(self) -> None:
        """Stop the robot, end `frames`, leave the network."""
        driver, self._driver, self._listener = self._driver, None, None
        if driver is not None:
            driver.close()
        self._closed.set()
        if self._busy.acquire(timeout=_RELEASE_S):
            try:
                network, self._network, self._told = self._network, None, None
                if network is not None:
                    network.close()
            finally:
                self._busy.release()

    def counters(self) -> Mapping[str, int]:
        """Return what was counted of each topic, by sensor; offsets of stamps in milliseconds."""
        counts = {f"{name}.{feed.sensor}": n for feed in self._feeds for name, n in feed.own_counts().items()}
        if self._driver is not None:
            counts["watchdog_stops"] = self._driver.n_watchdog_stops
        return counts

    @classmethod
    def survey(cls, where: str) -> Sequence[Mapping[str, str]]:
        """Return the topics of a domain, for ``trailmark inspect ros2://0``."""
        from trailmark_ros2.survey import survey_network  # a run has no use for it

        return survey_network(where)

    # --- sensors ---------------------------------------------------------------------------------------------------

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        """The sensors, by name; known after `start`."""
        return self._sensors

    def origins(self) -> Mapping[str, SensorOrigin]:
        """Return which topics tell mountings and lenses, by sensor."""
        return self._origins

    def _meet(self, network: dds.Network, patience: Patience) -> None:
        met = meet_writers(network, self._wanted(), patience, DEPTH)
        self._feeds = list(self._new_feeds(network, met))
        firsts = self._first_frames(patience)
        latched = dds.Quality(is_reliable=True, is_latched=True, depth=100)
        topic = self.config.tf_static
        tree = static_tree(first_message(network, topic, _TRANSFORMS, latched, _BESIDE_S), topic)
        infos = [self._info(network, tree, sensor, frame) for sensor, frame in firsts.items()]
        for feed in self._feeds:
            tell_of_frames(feed, tree, base_frame=self.config.base_frame, map_frame=self.config.map_frame)
        self._sensors = MappingProxyType({info.name: info for info in infos})

    def _wanted(self) -> dict[str, str | None]:
        config = self.config
        wanted = {config.options_of(sensor).topic: config.options_of(sensor).type for sensor in config.topics}
        return wanted | {topic: None for pair in config.rgbd.values() for topic in (pair.colour, pair.depth)}

    def _new_feeds(self, network: dds.Network, met: Mapping[str, MetTopic]) -> Iterator[TopicFeed]:
        config = self.config
        skips = config.on_bad_frame == "skip"

        def feed(sensor: str, topic: str, reader: object) -> TopicFeed:
            subscription = network.subscription(topic, met[topic].type_name, met[topic].quality)
            stamper = Stamper(topic, config.stamps, config.max_offset_s)
            return TopicFeed(sensor, subscription, reader, stamper, skips=skips)  # type: ignore[arg-type]

        for sensor in config.topics:
            options = config.options_of(sensor)
            yield feed(sensor, options.topic, new_reader(met[options.topic].type_name, options))
        for sensor, pair in config.rgbd.items():
            for topic in (pair.colour, pair.depth):
                if met[topic].type_name not in ros_messages.IMAGE_TYPES:
                    raise SourceError(f"{topic} is sent as {met[topic].type_name}, which is no picture")
            pairing = DepthPairing(pair.depth, pair.max_difference_s)
            yield from (feed(sensor, topic, pairing) for topic in (pair.colour, pair.depth))

    def _first_frames(self, patience: Patience) -> dict[str, Frame | None]:
        """Return the first frame of each sensor; of one that shows nothing, None after `silence_s`."""
        firsts: dict[str, Frame | None] = dict.fromkeys(feed.sensor for feed in self._feeds)
        began_s = time.monotonic()

        def has_all() -> bool:
            for feed in self._feeds:
                for frame in feed.take():
                    firsts[frame.sensor] = firsts[frame.sensor] or frame
            is_late = time.monotonic() - began_s > self.config.silence_s
            return not any(
                frame is None and (self._is_camera(sensor) or not is_late) for sensor, frame in firsts.items()
            )

        def missing() -> str:
            assert self._network is not None
            network = self._network
            silent = [feed for feed in self._feeds if firsts[feed.sensor] is None]
            return "; ".join(f"no message on {feed.topic}: {feed.silence_reason(network)}" for feed in silent)

        patience.wait_until(has_all, missing)
        return firsts

    def _is_camera(self, sensor: str) -> bool:
        return any(feed.sensor == sensor and feed.reader.kind in ("image", "rgbd") for feed in self._feeds)

    def _info(self, network: dds.Network, tree: FrameTree, sensor: str, first: Frame | None) -> SensorInfo:
        feed = next(feed for feed in self._feeds if feed.sensor == sensor)
        kind = feed.reader.kind
        mounting, where = None, ""
        if kind in ("image", "rgbd", "scan", "imu") and feed.frame_id:
            mounting, where = mounting_of(tree, self.config.base_frame, sensor, frame=feed.frame_id, kind=kind)
        size = None if first is None else first.payload.size
        lens = self._lens(network, feed.topic) if self._is_camera(sensor) else None
        self._origins[sensor] = SensorOrigin(where, "" if lens is None else ros_messages.info_topic(feed.topic))
        calibration = DepthCamera(lens) if lens is not None and kind == "rgbd" else lens
        return SensorInfo(sensor, kind, size, pose_base_sensor=mounting or Pose3(), calibration=calibration)

    def _lens(self, network: dds.Network, topic: str) -> Pinhole | None:
        beside = ros_messages.info_topic(topic)
        messages = first_message(network, beside, _CAMERA_INFO, dds.Quality(is_reliable=False), _BESIDE_S)
        return ros_messages.lens(messages[0], is_rectified="rect" in topic) if messages else None

    # --- frames ----------------------------------------------------------------------------------------------------

    def frames(self) -> Iterator[Frame]:
        """Yield what comes, until `close`; in the order of stamps of each sensor.

        Raises
        ------
        SourceError
            If a message cannot be used, with ``on_bad_frame: error``, or the robot's time went back.
        """
        closed = self._closed
        waiter: dds.Waiter | None = None
        looked_s = time.monotonic()
        while not closed.is_set():
            with self._busy:
                if closed.is_set() or self._network is None:
                    return
                waiter = waiter or self._network.waiter([feed.subscription for feed in self._feeds])
                waiter.wait(_LONGEST_WAIT_S)
                frames = [frame for feed in self._feeds for frame in feed.take()]
                self._pass_told_poses()
            if frames and self._driver is not None:
                self._driver.note_message()
            for frame in frames:
                if closed.is_set():
                    return
                yield frame
            if time.monotonic() - looked_s > _LOOK_EVERY_S:
                looked_s = time.monotonic()
                refuse_a_reset(self._feeds, 2.0 * _LOOK_EVERY_S)
                if self._check_silence():
                    waiter = None  # it waits for a subscription that was made anew
                if self._is_over():
                    return

    def _check_silence(self) -> bool:
        with self._busy:
            network = self._network
            if network is None:
                return False
            if self._listener is not None:
                self._listener.check(network)
            anew = [feed.check_silence(network, self.config.silence_s) for feed in self._feeds]
        return any(anew)

    def _is_over(self) -> bool:
        limit_s = self.config.end_when_silent_s
        heard_s = max(feed.last_heard_s for feed in self._feeds)
        return limit_s is not None and time.monotonic() - heard_s > limit_s

    def _pass_told_poses(self) -> None:
        """Pass on where a person says that the robot is."""
        for message in [] if self._told is None else self._told.messages():
            frame = str(message.header.frame_id).lstrip("/")
            if frame and frame != self.config.map_frame.lstrip("/"):
                log = logger.debug if self._has_told_frame else logger.warning
                log(
                    "%s is left alone: it is a pose in %r, and the map is %r (map_frame of the source, which is to be"
                    " that of the sink); in RViz set the Fixed Frame",
                    self.config.initial_pose,
                    frame,
                    self.config.map_frame,
                )
                self._has_told_frame = True
                continue
            try:
                pose = ros_messages.planar_pose(message.pose.pose)
            except ValueError as error:
                logger.warning("%s is left alone: %s", self.config.initial_pose, error)
                continue
            covariance = np.asarray(message.pose.covariance, float).reshape(6, 6)[_PLANAR]
            is_known = bool(np.all(np.isfinite(covariance)) and np.all(np.linalg.eigvalsh(covariance) > 0.0))
            logger.warning("%s: the robot is told to be at %s", self.config.initial_pose, pose)
            self._session.tell_pose(pose, covariance if is_known else None)

    # --- the robot -------------------------------------------------------------------------------------------------

    @property
    def accepts(self) -> frozenset[type[Command]]:
        """Velocities, or steering for an Ackermann vehicle; `Stop` always."""
        if not self._has_topic:
            return frozenset({Stop})
        return accepted_commands(self.config.command_type, self.config.wheelbase_m)

    def drive(self, command: Command) -> None:
        """Send a command; while a person drives, `Stop` alone."""
        if self._driver is not None and (not self.drives_itself or isinstance(command, Stop)):
            self._driver.drive(command)
