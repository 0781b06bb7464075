"""Path tracking with front and rear steering, Eqs. (6) to (8) of Nagai & Watanabe 2015.

Steering is counter-clockwise positive and the path's left is positive here, so that both gains enter
with a minus; the paper's image axes point the other way. Backwards, every sign turns over: the wheels then lead
the other way.
"""

from __future__ import annotations

import math

import numpy as np

from trailmark.commands import Command, Steer4WS, Stop, Velocity
from trailmark.estimates import Belief
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Controller, Session
from trailmark.paths import Path
from trailmark_controllers.following import starts_in_reverse, taught_path
from trailmark_controllers.path_tracking_config import PathTrackingConfig

__all__ = ["PathTracking4WS", "path_errors", "steering"]


def path_errors(path: Path, pose: Pose2, waypoint_idx: int, direction: int) -> tuple[float, float]:
    """Return the deviation from the path and from its heading: L and d_A of Eqs. (6) and (7).

    Parameters
    ----------
    path : Path
        The taught path.
    pose : Pose2
        P_CURRENT and theta_CURRENT.
    waypoint_idx : int
        m, the waypoint ahead; the line runs from the one before it, in the direction of travel.
    direction : {1, -1}
        1 along the taught sense, -1 against it.

    Returns
    -------
    lateral_m, heading_rad : float
        Left of the taught sense and counter-clockwise positive, also when driving backwards.
    """
    target = path[waypoint_idx].pose_map_base
    before_idx = min(max(waypoint_idx - direction, 0), len(path) - 1)
    u = path.positions[waypoint_idx] - path.positions[before_idx] if before_idx != waypoint_idx else np.zeros(2)
    u = u * direction
    length = math.hypot(u[0], u[1])
    if length == 0.0:  # a path of one place: its heading is the line
        u, length = np.array([math.cos(target.theta), math.sin(target.theta)]), 1.0
    v = (pose.x - target.x, pose.y - target.y)
    lateral_m = float(u[0] * v[1] - u[1] * v[0]) / length  # Eq. (6): the cross product
    return lateral_m, wrap_angle(pose.theta - target.theta)  # Eq. (7)


def steering(lateral_m: float, heading_rad: float, direction: int, config: PathTrackingConfig) -> tuple[float, float]:
    """Return front and rear steering angles [rad], Eq. (8) with its limits.

    Parameters
    ----------
    lateral_m : float
        Offset to the left of the path [m].
    heading_rad : float
        Heading against the path's tangent [rad].
    direction : int
        1 along the path, -1 back.
    config : PathTrackingConfig
        Gains and limits.

    Returns
    -------
    (float, float)
        Front and rear steering angle [rad].
    """
    same_phase = config.gain_position * lateral_m / config.pixel_m
    opposite_phase = config.gain_heading * math.degrees(heading_rad)
    unit_rad = math.radians(config.limit_deg) / config.limit_units
    limit = config.limit_units

    def angle(units: float) -> float:
        return -direction * min(max(units, -limit), limit) * unit_rad

    return angle(same_phase + opposite_phase), angle(same_phase - opposite_phase)


class PathTracking4WS(Controller):
    """Drives a four-wheel-steering robot along a taught path, there and back as often as asked."""

    config: PathTrackingConfig

    @property
    def gives(self) -> frozenset[type[Command]]:
        """`Steer4WS` and `Stop`."""
        return frozenset({Steer4WS, Stop})

    def remedy_for(self, accepts: frozenset[type[Command]]) -> str:
        """Return which controller gives what the robot takes."""
        return "take 'path_tracking', which drives other vehicles too" if Velocity in accepts else ""

    def start(self, session: Session) -> None:
        """Take the path; choose the direction by the config, or by the end at which the robot stands.

        Raises
        ------
        ConfigError
            If there is no taught path to follow.
        """
        self._path = taught_path(session, "path_tracking_4ws")
        self._direction = -1 if starts_in_reverse(self._path, session.start_pose, self.config.reverse) else 1
        self._legs_left = round(2 * self.config.repeat)
        self._station_m: float | None = None

    def step(self, belief: Belief) -> Command:
        """Return the steering for the belief; `Stop(done=True)` at the end of the last leg."""
        if belief.pose_map_base is None:
            return Stop("the pose is not known yet")
        # Its own station, not the belief's: a leg that turns back must not jump where the path crosses itself.
        self._station_m = self._path.locate(belief.pose_map_base, self._station_m).station_m
        if self._rest_m() <= self.config.arrive_m:
            self._legs_left -= 1
            if self._legs_left <= 0:
                return Stop("the end of the path is reached", done=True)
            self._direction = -self._direction
        idx = self._waypoint_ahead(belief.pose_map_base)
        errors = path_errors(self._path, belief.pose_map_base, idx, self._direction)
        front_rad, rear_rad = steering(*errors, self._direction, self.config)
        return Steer4WS(front_rad, rear_rad, self._direction * self._speed_mps())

    def _rest_m(self) -> float:
        """Way left to the end of this leg [m]."""
        assert self._station_m is not None
        end_m = self._path.stations[-1 if self._direction > 0 else 0]
        return float(end_m - self._station_m) * self._direction

    def _speed_mps(self) -> float:
        config = self.config
        if config.slow_down_m == 0.0:
            return config.speed_mps
        braking = config.speed_mps * self._rest_m() / config.slow_down_m
        return min(config.speed_mps, max(config.creep_mps, braking))

    def _waypoint_ahead(self, pose: Pose2) -> int:
        """Return m: the nearest waypoint ahead that is farther away than the look-ahead."""
        assert self._station_m is not None
        path, direction = self._path, self._direction
        idx = int(np.searchsorted(path.stations, self._station_m, side="right" if direction > 0 else "left"))
        idx = idx if direction > 0 else idx - 1
        last = len(path) - 1 if direction > 0 else 0
        while 0 <= idx <= len(path) - 1 and idx != last:
            if math.hypot(*(path.positions[idx] - (pose.x, pose.y))) > self.config.lookahead_m:
                break
            idx += direction
        return min(max(idx, 0), len(path) - 1)
