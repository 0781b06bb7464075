"""A vehicle whose front and rear wheels steer separately (Nagai & Watanabe, Sec. IV-A)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from trailmark.commands import Command, Steer4WS, Stop
from trailmark.errors import ConfigError
from trailmark.geometry import Twist2
from trailmark_sim.vehicles.base import Vehicle, VehicleState, WheelErrors, advance_state, follow_with_lag

__all__ = ["FourWheelSteering"]


@dataclass(frozen=True, slots=True)
class FourWheelSteering(Vehicle):
    """Four-wheel steering, base midway between the axles.

    With f, r the angles of the front and rear wheels, v the speed along x and L the wheelbase (single-track model):

        left speed  ``v (tan f + tan r) / 2``        yaw rate  ``v (tan f - tan r) / L``

    Attributes
    ----------
    length_m, width_m : float
        Outline [m]; 0.39 m wide in the paper.
    max_speed_mps : float
        Top speed [m/s].
    max_steer_rad : float
        Limit of both angles [rad]; 18.3 deg in the paper.
    min_turning_radius_m : float
        Radius at opposite full angles [m]; 0.75 m in the paper. It fixes the wheelbase.
    steer_lag_s, speed_lag_s : float
        Time constants of servos and drive [s].
    asymmetry : float
        The linkage turns the wheels this share further to the left and less to the right.
    front_trim_rad, rear_trim_rad : float
        Angle of the wheels when the servo stands at zero [rad].
    wheel_errors : WheelErrors
        Why its odometry is wrong; it also knows the servo's angle only, not the wheels'.
    """

    length_m: float = 0.60
    width_m: float = 0.39
    max_speed_mps: float = 0.5
    max_steer_rad: float = math.radians(18.3)
    min_turning_radius_m: float = 0.75
    steer_lag_s: float = 0.08
    speed_lag_s: float = 0.15
    asymmetry: float = 0.0
    front_trim_rad: float = 0.0
    rear_trim_rad: float = 0.0
    wheel_errors: WheelErrors = WheelErrors()

    @property
    def wheelbase_m(self) -> float:
        """Distance of the axles [m]: ``2 R tan(limit)``."""
        return 2.0 * self.min_turning_radius_m * math.tan(self.max_steer_rad)

    def steering_for(self, curvature: float) -> float:
        """Return the front angle, the rear's being its opposite, for a curvature [rad, 1/m]."""
        return math.atan(curvature * self.wheelbase_m / 2.0)

    @property
    def accepts(self) -> frozenset[type[Command]]:
        return frozenset({Steer4WS, Stop})

    def step(
        self, state: VehicleState, command: Command, dt_s: float, slip: tuple[float, float] = (0.0, 0.0)
    ) -> VehicleState:
        front, rear, speed = self._feasible_targets(state, command)
        front_mean, front_end = follow_with_lag(state.front_rad, front, dt_s, self.steer_lag_s)
        rear_mean, rear_end = follow_with_lag(state.rear_rad, rear, dt_s, self.steer_lag_s)
        speed_mean, speed_end = follow_with_lag(state.twist.forward_mps, speed, dt_s, self.speed_lag_s)
        return advance_state(
            state,
            mean=self._twist(
                self._wheel(front_mean, self.front_trim_rad), self._wheel(rear_mean, self.rear_trim_rad), speed_mean
            ),
            end=self._twist(
                self._wheel(front_end, self.front_trim_rad), self._wheel(rear_end, self.rear_trim_rad), speed_end
            ),
            wheels=self._twist(front_mean, rear_mean, speed_mean),
            dt_s=dt_s,
            errors=self.wheel_errors,
            slip=slip,
            steering=(front_end, rear_end),
        )

    def _feasible_targets(self, state: VehicleState, command: Command) -> tuple[float, float, float]:
        """Return front and rear angle and speed, limited."""
        if isinstance(command, Stop):
            return state.front_rad, state.rear_rad, 0.0
        if not isinstance(command, Steer4WS):
            raise ConfigError(
                f"a vehicle with four-wheel steering cannot follow {type(command).__name__}; use Steer4WS"
            )
        return (
            _limit(command.front_rad, self.max_steer_rad),
            _limit(command.rear_rad, self.max_steer_rad),
            _limit(command.speed_mps, self.max_speed_mps),
        )

    def _wheel(self, servo_rad: float, trim_rad: float) -> float:
        """Return the angle of the wheels for an angle of the servo: the linkage's own."""
        share = self.asymmetry if servo_rad > 0.0 else -self.asymmetry
        return _limit(servo_rad * (1.0 + share) + trim_rad, self.max_steer_rad)

    def _twist(self, front_rad: float, rear_rad: float, speed_mps: float) -> Twist2:
        front, rear = math.tan(front_rad), math.tan(rear_rad)
        return Twist2(speed_mps, speed_mps * (front + rear) / 2.0, speed_mps * (front - rear) / self.wheelbase_m)


def _limit(value: float, limit: float) -> float:
    return min(limit, max(-limit, value))
