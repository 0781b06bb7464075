"""A vehicle that drives in every direction."""

from __future__ import annotations

import math
from dataclasses import dataclass

from trailmark.commands import Command
from trailmark.geometry import Twist2
from trailmark_sim.vehicles.base import VehicleState, VelocityVehicle, WheelErrors, advance_state, follow_with_lag

__all__ = ["Holonomic"]


@dataclass(frozen=True, slots=True)
class Holonomic(VelocityVehicle):
    """Driven in every direction and turned independently of it.

    Attributes
    ----------
    length_m, width_m : float
        Outline [m]; 0.65 m wide in Tasaki et al.
    max_speed_mps : float
        Limit of the length of the velocity [m/s]; 1.0 m/s in Tasaki et al.
    max_yaw_radps : float
        Limit of the yaw rate [rad/s].
    speed_lag_s : float
        Time constant of the drives [s].
    wheel_errors : WheelErrors
        Why its odometry is wrong.
    """

    length_m: float = 0.65
    width_m: float = 0.65
    max_speed_mps: float = 1.0
    max_yaw_radps: float = 1.5
    speed_lag_s: float = 0.2
    wheel_errors: WheelErrors = WheelErrors()

    def step(
        self, state: VehicleState, command: Command, dt_s: float, slip: tuple[float, float] = (0.0, 0.0)
    ) -> VehicleState:
        forward, left, yaw = self._feasible_velocity(command)
        now = state.twist
        forward_mean, forward_end = follow_with_lag(now.forward_mps, forward, dt_s, self.speed_lag_s)
        left_mean, left_end = follow_with_lag(now.left_mps, left, dt_s, self.speed_lag_s)
        yaw_mean, yaw_end = follow_with_lag(now.yaw_radps, yaw, dt_s, self.speed_lag_s)
        mean = Twist2(forward_mean, left_mean, yaw_mean)
        return advance_state(state, mean, Twist2(forward_end, left_end, yaw_end), mean, dt_s, self.wheel_errors, slip)

    def _feasible_velocity(self, command: Command) -> tuple[float, float, float]:
        """Return the velocity that it can do, in the direction that was asked for."""
        wanted = self.velocity_of(command)
        speed = math.hypot(wanted.forward_mps, wanted.left_mps)
        share = min(1.0, self.max_speed_mps / speed) if speed > 0.0 else 1.0
        yaw = min(self.max_yaw_radps, max(-self.max_yaw_radps, wanted.yaw_radps))
        return wanted.forward_mps * share, wanted.left_mps * share, yaw
