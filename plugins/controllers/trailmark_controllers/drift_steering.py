"""Drift steering (Perroni Filho & Ohya 2014, Sec. IV): the taught bends again, and corrections against the drift.

It looks at `Belief.on_path` alone, so it steers by whatever localizer finds the robot on its path. The paper drives
straight paths only; here the taught curvature is replayed, and corrections are added to it.
"""

from __future__ import annotations

import math

from trailmark.commands import Command, Stop, Velocity
from trailmark.estimates import Belief, PathOffset
from trailmark.geometry import wrap_angle
from trailmark.interfaces import Controller, Session
from trailmark.paths import Path
from trailmark_controllers.drift_steering_config import DriftSteeringConfig
from trailmark_controllers.following import starts_in_reverse, taught_path

__all__ = ["DriftSteering", "StepLaw", "drift_angle", "smooth_bend", "taught_bend"]

# Half the stretch of path that the taught curvature is read from: waypoints are a few centimetres apart, and
# their headings carry the noise of what taught them.
_BEND_HALF_M = 0.1


def taught_bend(path: Path, station_m: float) -> float:
    """Return the curvature of the taught path [rad/m], counter-clockwise positive; 0 beyond the ends."""
    first_m, last_m = float(path.stations[0]), float(path.stations[-1])
    before_m, after_m = (min(max(station_m + side * _BEND_HALF_M, first_m), last_m) for side in (-1, 1))
    if after_m <= before_m:
        return 0.0
    return wrap_angle(path.pose_at(after_m).theta - path.pose_at(before_m).theta) / (after_m - before_m)


def drift_angle(offset: PathOffset, direction: int, lookahead_m: float) -> float:
    """Return heading and offset from the path as one angle to be turned away [rad], to the left positive.

    Driving backwards, the robot comes back to the path by turning the other way.
    """
    return offset.heading_rad + direction * math.atan2(offset.lateral_m, lookahead_m)


def smooth_bend(angle_rad: float, response_m: float, limit_per_m: float) -> float:
    """Return the curvature that takes a drift angle away within a response length [rad/m]."""
    return min(max(-angle_rad / response_m, -limit_per_m), limit_per_m)


class StepLaw:
    """The paper's way: turn against the drift, then drive straight until the drift is known again.

    While turning, streams are blind; after it they need a new window. So a correction is decided once for each
    absolute estimate that came after the last one.

    Parameters
    ----------
    dead_band_rad : float
        Smallest drift that is corrected [rad].
    limit_per_m : float
        Curvature of a correction [rad/m].
    """

    def __init__(self, dead_band_rad: float, limit_per_m: float) -> None:
        self._dead_band_rad = dead_band_rad
        self._limit_per_m = limit_per_m
        self._rest_rad = 0.0
        self._heading_rad: float | None = None
        self._settled_m: float | None = None

    def bend(self, belief: Belief, angle_rad: float, expected_turn_rad: float) -> float:
        """Return the curvature to add to the taught one [rad/m].

        Parameters
        ----------
        belief : Belief
            The belief; its heading from motion alone says how far a correction has come.
        angle_rad : float
            Drift angle [rad].
        expected_turn_rad : float
            What the taught path has turned since the last call [rad].
        """
        heading_rad = belief.pose_odom_base.theta
        if self._heading_rad is not None:
            self._rest_rad -= wrap_angle(heading_rad - self._heading_rad) - expected_turn_rad
        self._heading_rad = heading_rad
        if self._settled_m is None:  # turning, or nothing done yet
            if abs(self._rest_rad) > self._limit_per_m * 0.01:
                return math.copysign(self._limit_per_m, self._rest_rad)
            self._rest_rad, self._settled_m = 0.0, belief.travelled_m
        is_new = belief.fix_age_m < belief.travelled_m - self._settled_m
        if is_new and abs(angle_rad) > self._dead_band_rad:
            self._rest_rad, self._settled_m = -angle_rad, None
        else:
            self._rest_rad = 0.0
        return 0.0


class DriftSteering(Controller):
    """Drives a robot along a taught path, there and back as often as asked."""

    config: DriftSteeringConfig

    @property
    def gives(self) -> frozenset[type[Command]]:
        """`Velocity` and `Stop`."""
        return frozenset({Velocity, Stop})

    def start(self, session: Session) -> None:
        """Take the path; choose the direction by the config, or by the end at which the robot stands.

        Raises
        ------
        ConfigError
            If there is no taught path to follow.
        """
        config = self.config
        self._path = taught_path(session, "drift_steering")
        self._direction = -1 if starts_in_reverse(self._path, session.start_pose, self.config.reverse) else 1
        self._legs_left = round(2 * config.repeat)
        self._limit_per_m = math.radians(config.correction_limit_deg_per_m)
        self._steps = StepLaw(math.radians(config.dead_band_deg), self._limit_per_m)
        self._taught_rad: float | None = None
        self._searching_since_m: float | None = None

    def step(self, belief: Belief) -> Command:
        """Return the velocity for the belief; `Stop(done=True)` at the end of the last leg."""
        on_path = belief.on_path
        if on_path is None:
            return self._search(belief)
        self._searching_since_m = None
        if self._rest_m(on_path.station_m) <= self.config.arrive_m:
            self._legs_left -= 1
            if self._legs_left <= 0:
                return Stop("the end of the path is reached", done=True)
            self._direction = -self._direction
        along = self._direction * taught_bend(self._path, on_path.station_m)  # turn per way driven
        return self._velocity(along + self._correction(belief, on_path))

    def _correction(self, belief: Belief, on_path: PathOffset) -> float:
        config = self.config
        angle_rad = drift_angle(on_path, self._direction, config.lookahead_m)
        if config.law == "smooth":
            return smooth_bend(angle_rad, config.response_m, self._limit_per_m)
        taught_rad = self._path.pose_at(on_path.station_m).theta
        last_rad, self._taught_rad = self._taught_rad, taught_rad
        turned_rad = 0.0 if last_rad is None else wrap_angle(taught_rad - last_rad)
        return self._steps.bend(belief, angle_rad, turned_rad)

    def _velocity(self, bend_per_m: float) -> Velocity:
        """Return the velocity along a bend; slower where it is too sharp for the yaw limit."""
        config = self.config
        speed_mps = config.speed_mps
        yaw_limit_radps = math.radians(config.yaw_limit_deg_per_s)
        if abs(bend_per_m) * speed_mps > yaw_limit_radps:
            speed_mps = yaw_limit_radps / abs(bend_per_m)
        return Velocity(self._direction * speed_mps, 0.0, bend_per_m * speed_mps)

    def _search(self, belief: Belief) -> Command:
        """Drive on a little while the place on the path is unknown."""
        if self._searching_since_m is None:
            self._searching_since_m = belief.travelled_m
        if belief.travelled_m - self._searching_since_m >= self.config.search_m:
            return Stop("the place on the path is not known")
        return Velocity(self._direction * self.config.speed_mps / 2.0)

    def _rest_m(self, station_m: float) -> float:
        """Way left to the end of this leg [m]."""
        end_m = self._path.stations[-1 if self._direction > 0 else 0]
        return float(end_m - station_m) * self._direction
