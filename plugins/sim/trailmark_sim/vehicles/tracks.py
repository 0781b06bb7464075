"""Vehicles that turn by different speeds of their left and right wheels."""

from __future__ import annotations

from dataclasses import dataclass

from trailmark.commands import Command
from trailmark.geometry import Twist2
from trailmark_sim.vehicles.base import VehicleState, VelocityVehicle, WheelErrors, advance_state, follow_with_lag

__all__ = ["Differential", "SkidSteer"]


@dataclass(frozen=True, slots=True)
class Differential(VelocityVehicle):
    """Two driven wheels and a castor; it turns on the spot.

    Attributes
    ----------
    length_m, width_m : float
        Outline [m].
    max_speed_mps : float
        Top speed of either wheel [m/s]; faster commands are slowed with their curvature kept.
    track_m : float
        Distance of the wheels [m].
    speed_lag_s : float
        Time constant of the drives [s].
    wheel_errors : WheelErrors
        Why its odometry is wrong.
    """

    length_m: float = 0.45
    width_m: float = 0.40
    max_speed_mps: float = 0.3
    track_m: float = 0.34
    speed_lag_s: float = 0.1
    wheel_errors: WheelErrors = WheelErrors()

    def step(
        self, state: VehicleState, command: Command, dt_s: float, slip: tuple[float, float] = (0.0, 0.0)
    ) -> VehicleState:
        forward, yaw = self._feasible_targets(command)
        now = self._wheels(state.twist)
        forward_mean, forward_end = follow_with_lag(now.forward_mps, forward, dt_s, self.speed_lag_s)
        yaw_mean, yaw_end = follow_with_lag(now.yaw_radps, yaw, dt_s, self.speed_lag_s)
        wheels = Twist2(forward_mean, 0.0, yaw_mean)
        end = self._ground(Twist2(forward_end, 0.0, yaw_end))
        return advance_state(state, self._ground(wheels), end, wheels, dt_s, self.wheel_errors, slip)

    def _feasible_targets(self, command: Command) -> tuple[float, float]:
        """Return speed and yaw rate that the wheels can do."""
        wanted = self.velocity_of(command)
        fastest = abs(wanted.forward_mps) + abs(wanted.yaw_radps) * self.track_m / 2.0
        share = min(1.0, self.max_speed_mps / fastest) if fastest > 0.0 else 1.0
        return wanted.forward_mps * share, wanted.yaw_radps * share

    def _ground(self, wheels: Twist2) -> Twist2:
        """Return how the body moves when the wheels turn."""
        return wheels

    def _wheels(self, twist: Twist2) -> Twist2:
        """Return how the wheels turn when the body moves: the inverse of `_ground`."""
        return twist


@dataclass(frozen=True, slots=True)
class SkidSteer(Differential):
    """Four wheels or crawlers that skid sideways when it turns.

    Attributes
    ----------
    turn_share : float
        Yaw rate over what the wheels' speeds would give without skidding.
    icr_forward_m : float
        How far before base it turns about: base itself slides sideways by it in a turn [m].
    """

    length_m: float = 0.60
    width_m: float = 0.50
    track_m: float = 0.42
    turn_share: float = 0.65
    icr_forward_m: float = 0.03

    def _ground(self, wheels: Twist2) -> Twist2:
        yaw_radps = wheels.yaw_radps * self.turn_share
        return Twist2(wheels.forward_mps, -self.icr_forward_m * yaw_radps, yaw_radps)

    def _wheels(self, twist: Twist2) -> Twist2:
        return Twist2(twist.forward_mps, 0.0, twist.yaw_radps / self.turn_share)
