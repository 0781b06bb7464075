"""A vehicle that steers its front wheels, as cars do."""

from __future__ import annotations

import math
from dataclasses import dataclass

from trailmark.commands import Command
from trailmark.geometry import Twist2
from trailmark_sim.vehicles.base import VehicleState, VelocityVehicle, WheelErrors, advance_state, follow_with_lag

__all__ = ["Ackermann"]


@dataclass(frozen=True, slots=True)
class Ackermann(VelocityVehicle):
    """Front wheels steer, rear wheels do not; base is the middle of the rear axle, as ROS has it.

    A velocity asks for a bend, ``yaw / forward``, which the servo follows as far as it turns: single-track model,
    ``yaw rate = v tan(steering) / wheelbase``. Standing, it keeps its steering. Velocities to the left are ignored.

    Attributes
    ----------
    length_m, width_m : float
        Outline, centred on base: it reaches as far behind the rear axle as before it [m].
    max_speed_mps : float
        Top speed [m/s].
    wheelbase_m : float
        Distance of the axles [m].
    max_steer_rad : float
        Full lock [rad].
    steer_lag_s, speed_lag_s : float
        Time constants of servo and drive [s].
    wheel_errors : WheelErrors
        Why its odometry is wrong.
    """

    length_m: float = 0.60
    width_m: float = 0.36
    max_speed_mps: float = 1.0
    wheelbase_m: float = 0.36
    max_steer_rad: float = math.radians(28.0)
    steer_lag_s: float = 0.1
    speed_lag_s: float = 0.15
    wheel_errors: WheelErrors = WheelErrors()

    @property
    def min_turning_radius_m(self) -> float:
        """Radius at full lock [m]."""
        return self.wheelbase_m / math.tan(self.max_steer_rad)

    def step(
        self, state: VehicleState, command: Command, dt_s: float, slip: tuple[float, float] = (0.0, 0.0)
    ) -> VehicleState:
        steer, speed = self._feasible_targets(state, command)
        steer_mean, steer_end = follow_with_lag(state.front_rad, steer, dt_s, self.steer_lag_s)
        speed_mean, speed_end = follow_with_lag(state.twist.forward_mps, speed, dt_s, self.speed_lag_s)
        mean = self._twist(steer_mean, speed_mean)
        end = self._twist(steer_end, speed_end)
        return advance_state(state, mean, end, mean, dt_s, self.wheel_errors, slip, steering=(steer_end, 0.0))

    def _feasible_targets(self, state: VehicleState, command: Command) -> tuple[float, float]:
        """Return the steering angle and the speed that it can do."""
        wanted = self.velocity_of(command)
        speed = min(self.max_speed_mps, max(-self.max_speed_mps, wanted.forward_mps))
        if wanted.forward_mps == 0.0:
            return state.front_rad, 0.0
        steer = math.atan(self.wheelbase_m * wanted.yaw_radps / wanted.forward_mps)
        return min(self.max_steer_rad, max(-self.max_steer_rad, steer)), speed

    def _twist(self, steer_rad: float, speed_mps: float) -> Twist2:
        return Twist2(speed_mps, 0.0, speed_mps * math.tan(steer_rad) / self.wheelbase_m)
