"""Path tracking for vehicles of four kinds: differential, holonomic, Ackermann and four-wheel steering."""

from __future__ import annotations

import math

from trailmark.commands import Command, Steer4WS, Stop, Velocity
from trailmark.estimates import Belief
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Controller, Session
from trailmark_controllers.caution import caution_of
from trailmark_controllers.following import taught_path
from trailmark_controllers.legs import Leg, legs_of, place_on_legs, stretches_of
from trailmark_controllers.tracking_config import TrackingConfig
from trailmark_controllers.tracking_laws import BesidePath, approach_angle, slide, steer_both_axles, turn_per_way

__all__ = ["PathTracking"]

#: A turn on the spot, once begun, ends with the heading this near [rad]; yaw rate per angle to turn [1/s].
_TURNED_RAD = math.radians(4.0)
_TURN_GAIN = 1.5
#: An offset is not driven out on less than so many times the way that the robot's lag takes.
_LAGS = 5.0
#: Without a command for longer, somebody else has stopped the robot: it gathers speed from rest [s].
_PAUSE_S = 0.5
#: Share of the speed that is left however far the robot looks away from its way.
_LEAST_SHARE = 0.3


class PathTracking(Controller):
    """Drives a robot along a taught path, there and back as often as asked, from wherever beside it it stands."""

    config: TrackingConfig

    @property
    def gives(self) -> frozenset[type[Command]]:
        """`Steer4WS` or `Velocity`, as `drive` says, and `Stop`."""
        return frozenset({Steer4WS if self.config.drive == "four_wheel_steering" else Velocity, Stop})

    def remedy_for(self, accepts: frozenset[type[Command]]) -> str:
        """Return the `drive` that gives what the robot takes."""
        if Steer4WS in accepts:
            return "for a robot that steers in front and behind write 'drive: four_wheel_steering'"
        if Velocity in accepts:
            return "for a robot that takes velocities write 'drive: differential', 'holonomic' or 'ackermann'"
        return ""

    def start(self, session: Session) -> None:
        """Take the path; smooth it.

        Raises
        ------
        ConfigError
            If there is no taught path to follow.
        """
        self._stretches = stretches_of(taught_path(session, "path_tracking"), self.config.smooth_m)
        self._legs: list[Leg] = []
        self._station_m = 0.0
        self._start_m: float | None = None
        self._is_turning = False
        self._speed_mps = 0.0
        self._stamp_s: float | None = None

    def step(self, belief: Belief) -> Command:
        """Return the command for a belief; `Stop` while it is too doubtful, `Stop(done=True)` at the end."""
        caution = caution_of(belief, self._way_without_fix(belief), self.config)
        pose = belief.pose_map_base
        if pose is None or caution.reason:
            return self._stand(belief, caution.reason)
        if not self._legs:
            self._legs = self._choose_legs(pose)
        leg = self._leg_now(pose)
        if leg is None:
            return Stop("the end of the path is reached", done=True)
        off_m = pose.distance_to(leg.path.pose_at(self._station_m))
        if off_m > self.config.max_offset_m:
            return self._stand(belief, f"{off_m:.2f} m off the path (max_offset_m: {self.config.max_offset_m:g})")
        speed_mps = self._speed(leg, belief.stamp_s, caution.share)
        return self._command(self._beside(leg, pose, speed_mps), speed_mps)

    def _way_without_fix(self, belief: Belief) -> float:
        if self._start_m is None:
            self._start_m = belief.travelled_m
        return min(belief.fix_age_m, belief.travelled_m - self._start_m)

    def _stand(self, belief: Belief, reason: str) -> Stop:
        self._speed_mps, self._stamp_s = 0.0, belief.stamp_s
        return Stop(reason)

    def _choose_legs(self, pose: Pose2) -> list[Leg]:
        """Return what is to be driven, from the place on it where the robot stands."""
        legs = legs_of(self._stretches, self.config, is_reverse=bool(self.config.reverse))
        n_way = len(self._stretches)
        first, self._station_m = place_on_legs(legs[:n_way], pose)
        start_m, end_m = (float(self._stretches[end].path.stations[end]) for end in (0, -1))
        if self.config.reverse is None and self._station_m > (start_m + end_m) / 2.0:
            legs = legs_of(self._stretches, self.config, is_reverse=True)
            first, self._station_m = place_on_legs(legs[:n_way], pose)
        return legs[first:]

    def _leg_now(self, pose: Pose2) -> Leg | None:
        """Return the leg that is driven; None at the end of the last. Keeps the station."""
        while self._legs:
            leg = self._legs[0]
            # Its own station, not the belief's: a leg that turns back must not jump where the path crosses itself.
            self._station_m = leg.path.locate(pose, self._station_m).station_m
            if leg.rest_m(self._station_m) > self.config.arrive_m:
                return leg
            self._legs.pop(0)
            self._speed_mps = 0.0
            if self._legs:
                self._station_m = self._legs[0].first_station_m
        return None

    def _speed(self, leg: Leg, stamp_s: float, share: float) -> float:
        """Return the speed: what bends, the end and the belief allow, and no more than the drive can gather."""
        config = self.config
        since_s = math.inf if self._stamp_s is None else stamp_s - self._stamp_s
        if not 0.0 <= since_s <= _PAUSE_S:  # it stands, whoever has stopped it
            self._speed_mps, since_s = 0.0, 0.0
        rolls_m = self._speed_mps * config.lag_s
        rest_m = max(0.0, leg.rest_m(self._station_m) - rolls_m)
        braking_mps = math.sqrt(config.creep_mps**2 + 2.0 * config.accel_mps2 * rest_m)
        limit_mps = leg.limit_at(self._station_m + leg.direction * rolls_m)
        gathered_mps = self._speed_mps + config.accel_mps2 * since_s
        speed_mps = max(config.creep_mps, min(share * min(limit_mps, braking_mps), gathered_mps))
        self._speed_mps, self._stamp_s = speed_mps, stamp_s
        return speed_mps

    def _beside(self, leg: Leg, pose: Pose2, speed_mps: float) -> BesidePath:
        on_path = leg.path.locate(pose, self._station_m)
        ahead_m = self._station_m + leg.direction * speed_mps * self.config.lag_s
        along_rad = leg.path.tangent_at(ahead_m) + (0.0 if leg.direction > 0 else math.pi)
        # Where the heading will be when the command is followed, so that a bend is not begun too early.
        heading_rad = leg.path.pose_at(ahead_m).theta + on_path.heading_rad
        return BesidePath(
            leg.direction * on_path.lateral_m,
            on_path.heading_rad,
            wrap_angle(along_rad - heading_rad),
            leg.bend_at(ahead_m),
        )

    def _command(self, beside: BesidePath, speed_mps: float) -> Command:
        config = self.config
        over_m = max(config.correct_over_m, _LAGS * speed_mps * config.lag_s)
        if config.drive == "four_wheel_steering":
            limit_rad = math.radians(config.steer_limit_deg)
            return steer_both_axles(beside, speed_mps, over_m, wheelbase_m=config.wheelbase_m, limit_rad=limit_rad)
        if config.drive == "holonomic":
            wanted = slide(beside, speed_mps, over_m)
            return Velocity(wanted.forward_mps, wanted.left_mps, self._limit_yaw_rate(wanted.yaw_radps))
        rest_rad = wrap_angle(beside.heading_rad - approach_angle(beside.lateral_m, over_m))
        if config.drive == "differential" and self._turns_first(rest_rad):
            self._speed_mps = 0.0
            return Velocity(0.0, 0.0, self._limit_yaw_rate(-_TURN_GAIN * rest_rad))
        return self._drive(beside, speed_mps * max(_LEAST_SHARE, math.cos(rest_rad)), over_m)

    def _drive(self, beside: BesidePath, speed_mps: float, over_m: float) -> Velocity:
        """Return the velocity of a robot that drives along its own axis."""
        bend_per_m = turn_per_way(beside, over_m)
        if self.config.drive == "ackermann" and self.config.min_turning_radius_m > 0.0:
            sharpest = 1.0 / self.config.min_turning_radius_m
            bend_per_m = min(max(bend_per_m, -sharpest), sharpest)
        elif abs(bend_per_m) * speed_mps > math.radians(self.config.yaw_limit_dps):
            bend_per_m = math.copysign(math.radians(self.config.yaw_limit_dps) / speed_mps, bend_per_m)
        return Velocity(-speed_mps if beside.is_backwards else speed_mps, 0.0, bend_per_m * speed_mps)

    def _turns_first(self, rest_rad: float) -> bool:
        """Return whether to turn on the spot; a turn that was begun is ended."""
        limit_rad = _TURNED_RAD if self._is_turning else math.radians(self.config.turn_first_deg)
        self._is_turning = abs(rest_rad) > limit_rad
        return self._is_turning

    def _limit_yaw_rate(self, yaw_radps: float) -> float:
        limit_radps = math.radians(self.config.yaw_limit_dps)
        return min(max(yaw_radps, -limit_radps), limit_radps)
