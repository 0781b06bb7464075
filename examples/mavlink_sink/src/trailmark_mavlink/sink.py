"""Beliefs to an autopilot."""

from __future__ import annotations

import math
import socket

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from trailmark.errors import ConfigError
from trailmark.estimates import Belief
from trailmark.geometry import Pose2
from trailmark.interfaces import Session, Sink
from trailmark_mavlink.config import MavlinkSinkConfig
from trailmark_mavlink.frames import covariance_21, pose_frd, pose_ned

__all__ = ["MavlinkSink"]

_UNKNOWN = [math.nan] + [0.0] * 20


class MavlinkSink(Sink):
    """Sends what is believed as ODOMETRY, VISION_POSITION_ESTIMATE or both.

    Nothing is sent while the pose is unknown or too uncertain: an autopilot notices silence by itself. A belief that
    jumps, when the robot is found again, counts `reset_counter` up.
    """

    config: MavlinkSinkConfig

    def __init__(self, config: MavlinkSinkConfig) -> None:
        super().__init__(config)
        self._socket: socket.socket | None = None

    def start(self, session: Session) -> None:
        """Open the socket.

        Raises
        ------
        ConfigError
            If the host has no address.
        """
        self.close()
        try:
            found = socket.getaddrinfo(self.config.host, self.config.port, type=socket.SOCK_DGRAM)
        except OSError as error:
            raise ConfigError(f"mavlink: {self.config.host} has no address: {error}") from error
        family, kind, _, _, self._to = found[0]
        self._socket = socket.socket(family, kind)
        component = mavlink.MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY
        self._mavlink = mavlink.MAVLink(None, srcSystem=self.config.system, srcComponent=component)
        self._due_s = -math.inf
        self._n_resets = 0
        self._last: tuple[Pose2, Pose2] | None = None

    def close(self) -> None:
        """Close the socket."""
        opened, self._socket = self._socket, None
        if opened is not None:
            opened.close()

    def on_belief(self, belief: Belief) -> None:
        """Send a belief, if it is time and the robot knows where it is."""
        pose = belief.pose_map_base
        if self._socket is None or pose is None or self._is_doubtful(belief):
            return
        self._note_jump(pose, belief.pose_odom_base)
        if belief.stamp_s < self._due_s:
            return
        self._due_s = belief.stamp_s + 1.0 / self.config.rate_hz - 1e-6
        if "odometry" in self.config.messages:
            self._send(self._odometry(belief, pose))
        if "vision_position_estimate" in self.config.messages:
            self._send(self._vision_position(belief, pose))

    def _is_doubtful(self, belief: Belief) -> bool:
        if belief.covariance is None:
            return False
        variance = float(np.linalg.eigvalsh(belief.covariance[:2, :2])[-1])
        return not variance <= self.config.max_sigma_m**2  # NaN is doubtful too

    def _note_jump(self, pose_map_base: Pose2, pose_odom_base: Pose2) -> None:
        """Count a belief that is not where motion has brought the last one."""
        if self._last is not None:
            last_map, last_odom = self._last
            expected = last_map @ last_odom.between(pose_odom_base)
            if expected.distance_to(pose_map_base) > self.config.jump_m:
                self._n_resets = (self._n_resets + 1) % 256
        self._last = pose_map_base, pose_odom_base

    def _odometry(self, belief: Belief, pose: Pose2) -> mavlink.MAVLink_message:
        x, y, yaw_rad = pose_frd(pose)
        twist = belief.twist
        return self._mavlink.odometry_encode(
            time_usec=_usec(belief.stamp_s),
            frame_id=mavlink.MAV_FRAME_LOCAL_FRD,
            child_frame_id=mavlink.MAV_FRAME_BODY_FRD,
            x=x,
            y=y,
            z=0.0,
            q=[math.cos(yaw_rad / 2.0), 0.0, 0.0, math.sin(yaw_rad / 2.0)],  # w, x, y, z
            vx=twist.forward_mps,
            vy=-twist.left_mps,
            vz=0.0,
            rollspeed=0.0,
            pitchspeed=0.0,
            yawspeed=-twist.yaw_radps,
            pose_covariance=covariance_21(belief.covariance),
            velocity_covariance=_UNKNOWN,
            reset_counter=self._n_resets,
            estimator_type=mavlink.MAV_ESTIMATOR_TYPE_VISION,
            quality=100,
        )

    def _vision_position(self, belief: Belief, pose: Pose2) -> mavlink.MAVLink_message:
        north_rad = math.radians(self.config.north_deg)
        north_m, east_m, yaw_rad = pose_ned(pose, north_rad)
        return self._mavlink.vision_position_estimate_encode(
            usec=_usec(belief.stamp_s),
            x=north_m,
            y=east_m,
            z=0.0,
            roll=0.0,
            pitch=0.0,
            yaw=yaw_rad,
            covariance=covariance_21(belief.covariance, north_rad),
            reset_counter=self._n_resets,
        )

    def _send(self, message: mavlink.MAVLink_message) -> None:
        if self._socket is not None:
            self._socket.sendto(message.pack(self._mavlink), self._to)
            self._mavlink.seq = (self._mavlink.seq + 1) % 256


def _usec(stamp_s: float) -> int:
    return max(0, round(stamp_s * 1e6))
