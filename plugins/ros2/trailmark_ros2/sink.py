"""Beliefs to ROS 2."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

from trailmark.commands import Command, Stop
from trailmark.errors import SourceError
from trailmark.estimates import Belief, EstimateRecord
from trailmark.geometry import Pose2
from trailmark.interfaces import RunEnd, Session, Sink
from trailmark_ros2 import dds
from trailmark_ros2.believing import BeliefMessages, diagnostics_bytes, path_bytes
from trailmark_ros2.config import Ros2SinkConfig
from trailmark_ros2.lostness import Lostness
from trailmark_ros2.robot_odometry import RobotOdometry
from trailmark_ros2.writers import WriterChoice

__all__ = ["Ros2Sink"]

logger = logging.getLogger(__name__)

_DIAGNOSTICS_EVERY_S = 1.0
_PATH_EVERY_S = 0.5
_LONGEST_PATH = 5000
# As many wait here while nobody asks for transforms: of 1 kHz those of the last half second.
_ODOMETRY_DEPTH = 500
# While nobody does they are not all read at once, which would hold up the run.
_MOST_UNASKED = 20
_LATCHED = dds.Quality(is_reliable=True, is_latched=True, depth=1)


class Ros2Sink(Sink):
    """Publishes what is believed: transform, odometry, pose, paths, diagnostics.

    ``pose_map_odom = pose_map_base @ pose_odom_base.inverse()``, both at the stamp of the belief, where
    ``pose_odom_base`` is the robot's own odometry: of a localizer Nav2 wants no more. While the robot is lost nothing
    but diagnostics is sent, which say why.
    """

    config: Ros2SinkConfig

    def __init__(self, config: Ros2SinkConfig) -> None:
        super().__init__(config)
        self._network: dds.Network | None = None
        self._publishers: dict[str, dds.Publisher] = {}
        self._odom: dds.Subscription | None = None

    # --- life ------------------------------------------------------------------------------------------------------

    def start(self, session: Session) -> None:
        """Enter the network, and publish the taught path.

        Raises
        ------
        ConfigError
            If the network cannot be entered.
        """
        self.close()
        config = self.config
        self._lostness, self._robot_odometry = Lostness(), RobotOdometry()
        self._odom_writers = WriterChoice()
        self._told: set[str] = set()  # why messages of the robot's odometry were left out
        self._messages = BeliefMessages(config.map_frame, config.base_frame)
        path_bytes([], 0.0, config.map_frame)  # the first message of a type takes 0.1 s, which the first belief lacks
        self._way: list[Pose2] = []
        self._drawn_s = self._diagnosed_s = float("-inf")
        self._held_back = ""
        self._command = "none"
        domain = dds.default_domain() if config.domain is None else config.domain
        self._network = dds.Network(domain, config.interface)
        transforms = config.tf_topic if config.tf != "none" else None
        self._publish("tf", transforms, "tf2_msgs/msg/TFMessage", dds.Quality(depth=100))
        self._publish("odometry", config.odometry, "nav_msgs/msg/Odometry")
        self._publish("pose", config.pose, "geometry_msgs/msg/PoseWithCovarianceStamped")
        self._publish("path", config.path, "nav_msgs/msg/Path", _LATCHED)
        self._publish("diagnostics", config.diagnostics, "diagnostic_msgs/msg/DiagnosticArray")
        if config.tf == "map_odom":
            best_effort = dds.Quality(is_reliable=False, depth=_ODOMETRY_DEPTH)
            self._odom = self._network.subscription(config.odom, "nav_msgs/msg/Odometry", best_effort)
        if session.path is not None:
            self._publish("taught_path", config.taught_path, "nav_msgs/msg/Path", _LATCHED)
            poses = [waypoint.pose_map_base for waypoint in session.path.waypoints]
            self._send("taught_path", lambda: path_bytes(poses, time.time(), config.map_frame))

    def close(self) -> None:
        """Leave the network."""
        network, self._network, self._odom = self._network, None, None
        self._publishers = {}
        if network is not None:
            network.close()

    def _publish(self, name: str, topic: str | None, type_name: str, quality: dds.Quality | None = None) -> None:
        assert self._network is not None
        if topic is not None:
            self._publishers[name] = self._network.publisher(topic, type_name, quality or dds.Quality())

    def _send(self, name: str, message_of: Callable[[], bytes]) -> None:
        """Publish a message, which is not even built where nobody reads it: of latched ones the last is kept."""
        if self._is_wanted(name):
            self._publishers[name].send_bytes(message_of())

    def _is_wanted(self, name: str) -> bool:
        publisher = self._publishers.get(name)
        return publisher is not None and publisher.is_wanted

    # --- what happens ----------------------------------------------------------------------------------------------

    def on_estimate_record(self, record: EstimateRecord) -> None:
        """Take note of who is lost."""
        self._lostness.note_estimate(record)

    def on_command(self, stamp_s: float, command: Command) -> None:
        """Take note of the command, for diagnostics."""
        self._command = f"stop: {command.reason}" if isinstance(command, Stop) else type(command).__name__.lower()

    def on_belief(self, belief: Belief) -> None:
        """Publish a belief, if the robot is not lost."""
        if self._network is None:
            return
        lost = self._lostness.reason(belief)
        pose = belief.pose_map_base
        if pose is not None and (not lost or self.config.tf_while_lost):
            is_wanted = self._is_wanted("tf")
            is_behind = self._read_odometry(_ODOMETRY_DEPTH if is_wanted else _MOST_UNASKED)
            if is_wanted or (self._is_diagnosis_due(belief) and not is_behind):
                self._held_back = self._send_transform(belief, pose)
            self._send("odometry", lambda: self._messages.odometry(belief))
            self._send("pose", lambda: self._messages.pose(belief))
            self._draw_way(belief.stamp_s, pose)
        self._diagnose(belief, lost)

    def on_end(self, end: RunEnd) -> None:
        """Say in diagnostics how the run ended."""
        summary = f"the run is over: {end.status} {end.reason}".strip()
        level = "error" if end.status == "failed" else "warn"
        diagnostics = self._publishers.get("diagnostics")
        if diagnostics is not None and diagnostics.n_matched:  # asked anew: who came just now is to hear it
            diagnostics.send_bytes(diagnostics_bytes(time.time(), "trailmark", level, {}, summary=summary))
        for publisher in self._publishers.values():
            publisher.wait_for_acknowledgments(0.1)

    # --- what is published -----------------------------------------------------------------------------------------

    def _send_transform(self, belief: Belief, pose_map_base: Pose2) -> str:
        """Publish the transform; return why it is not published, empty where it is."""
        config = self.config
        ahead_s = belief.stamp_s + config.transform_tolerance_s
        if config.tf == "map_base":
            child, pose = config.base_frame, pose_map_base
        elif config.tf == "map_odom":
            pose_odom_base = self._robot_odometry.pose_odom_base(belief.stamp_s)
            if pose_odom_base is None:
                return f"{config.odom} has no pose of the belief's stamp: is it there, with the stamps of the sensors?"
            child = config.odom_frame or self._robot_odometry.frame_id
            pose = pose_map_base @ pose_odom_base.inverse()
        else:
            return ""
        self._send("tf", lambda: self._messages.transform(pose, ahead_s, child))
        return ""

    def _read_odometry(self, n_most: int) -> bool:
        """Take what has come of the robot's odometry; return whether there may be more of it."""
        if self._odom is None:
            return False
        samples, now_s = self._odom.take(n_most), time.monotonic()
        for sample in samples:
            if not self._odom_writers.counts(sample.writer, now_s):
                if self._odom_writers.is_contested:
                    self._leave_out("programs", "two programs send it at once, and the one that came first counts")
            elif (message := self._odom.message_of(sample)) is not None:
                try:
                    self._robot_odometry.add(message, sample.writer)
                except (SourceError, ValueError) as error:
                    self._leave_out(type(error).__name__, str(error))
        return len(samples) == n_most

    def _leave_out(self, reason: str, why: str) -> None:
        """Say once for each reason that the robot's odometry cannot be used: the transform would be wrong."""
        log = logger.debug if reason in self._told else logger.warning
        log("%s: a message is left out, others silently: %s", self.config.odom, why)
        self._told.add(reason)

    def _draw_way(self, stamp_s: float, pose: Pose2) -> None:
        if not self._way or self._way[-1].distance_to(pose) >= self.config.path_spacing_m:
            self._way.append(pose)
            del self._way[:-_LONGEST_PATH]
        if stamp_s - self._drawn_s >= _PATH_EVERY_S:
            self._drawn_s = stamp_s
            self._send("path", lambda: path_bytes(self._way, stamp_s, self.config.map_frame))

    def _is_diagnosis_due(self, belief: Belief) -> bool:
        return belief.stamp_s - self._diagnosed_s >= _DIAGNOSTICS_EVERY_S

    def _diagnose(self, belief: Belief, lost: str) -> None:
        if not self._is_diagnosis_due(belief):
            return
        self._diagnosed_s = belief.stamp_s
        level = "error" if lost else ("warn" if self._held_back or belief.health else "ok")
        summary = f"lost: {lost}" if lost else (self._held_back or "localized")
        numbers = {
            "fix_age_m": belief.fix_age_m,
            "motion_age_s": belief.motion_age_s,
            "travelled_m": belief.travelled_m,
        }
        values = {name: f"{value:.3f}" for name, value in numbers.items()} | {"command": self._command}
        values |= {f"health of {name}": text for name, text in belief.health.items()}
        self._send(
            "diagnostics",
            lambda: diagnostics_bytes(belief.stamp_s, "trailmark", level, values, summary=summary),
        )
