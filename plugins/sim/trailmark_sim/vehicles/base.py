"""What all vehicles share: the state, the lag of an actuator, the errors of wheels."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

from trailmark.commands import Command, Stop, Velocity
from trailmark.errors import ConfigError
from trailmark.geometry import Pose2, Twist2

__all__ = ["Vehicle", "VehicleState", "VelocityVehicle", "WheelErrors", "advance_state", "follow_with_lag"]


@dataclass(frozen=True, slots=True)
class VehicleState:
    """What is true of a vehicle at one instant.

    Attributes
    ----------
    pose_map_base : Pose2
        True pose.
    twist : Twist2
        True velocity in base axes.
    front_rad, rear_rad : float
        Where the steering servos stand, counter-clockwise; zero for vehicles that do not steer [rad].
    travelled_m : float
        Length of the way driven so far; grows also backwards [m].
    forward_mps2, left_mps2 : float
        Acceleration of base along its axes, the centripetal part included [m/s^2].
    yaw_radps2 : float
        Angular acceleration [rad/s^2].
    pose_start_wheels : Pose2
        Where the wheels think it is, seen from the start: dead reckoning with slip and scale error.
    wheels_m : float
        Distance by the wheels; backwards counts negative [m].
    """

    pose_map_base: Pose2 = Pose2()
    twist: Twist2 = Twist2()
    front_rad: float = 0.0
    rear_rad: float = 0.0
    travelled_m: float = 0.0
    forward_mps2: float = 0.0
    left_mps2: float = 0.0
    yaw_radps2: float = 0.0
    pose_start_wheels: Pose2 = Pose2()
    wheels_m: float = 0.0


@dataclass(frozen=True, slots=True)
class WheelErrors:
    """Why wheel odometry is wrong.

    Attributes
    ----------
    scale : float
        Relative error of every distance: worn or soft tyres.
    turn_scale : float
        Relative error of every turn: a track or wheelbase that is not as drawn.
    slip_m, slip_rad : float
        Standard deviation of distance and of turn after one metre of way [m, rad]; it grows with the root of the way.
    """

    scale: float = 0.01
    turn_scale: float = 0.02
    slip_m: float = 0.002
    slip_rad: float = 0.005


class Vehicle(ABC):
    """A vehicle: frozen numbers and a pure step.

    Attributes
    ----------
    length_m, width_m : float
        Outline, centred on base [m].
    max_speed_mps : float
        What it drives at most [m/s].
    speed_lag_s : float
        Time constant of the drive: after `Stop` it rolls on by speed times lag [s].
    wheel_errors : WheelErrors
        Why its odometry is wrong.
    """

    length_m: float
    width_m: float
    max_speed_mps: float
    speed_lag_s: float
    wheel_errors: WheelErrors

    @property
    @abstractmethod
    def accepts(self) -> frozenset[type[Command]]:
        """The commands it understands."""

    @abstractmethod
    def step(
        self, state: VehicleState, command: Command, dt_s: float, slip: tuple[float, float] = (0.0, 0.0)
    ) -> VehicleState:
        """Return the state after `dt_s` seconds of a command; `slip` are two standard normal numbers."""


class VelocityVehicle(Vehicle):
    """A vehicle that follows velocities."""

    @property
    def accepts(self) -> frozenset[type[Command]]:
        return frozenset({Velocity, Stop})

    def velocity_of(self, command: Command) -> Velocity:
        """Return the velocity that a command asks for; zero for `Stop`.

        Raises
        ------
        ConfigError
            If it asks for something else.
        """
        if isinstance(command, Stop):
            return Velocity(0.0)
        if not isinstance(command, Velocity):
            raise ConfigError(f"a {type(self).__name__} vehicle cannot follow {type(command).__name__}; use Velocity")
        return command


def follow_with_lag(now: float, wanted: float, dt_s: float, lag_s: float) -> tuple[float, float]:
    """Return the mean over a step and the value at its end of an actuator with a first-order lag.

    ``y(t) = wanted + (now - wanted) exp(-t / lag)``, in closed form: steps of any length agree.
    """
    if lag_s <= 0.0:
        return wanted, wanted
    decay = math.exp(-dt_s / lag_s)
    mean = wanted + (now - wanted) * (1.0 - decay) * lag_s / dt_s
    return mean, wanted + (now - wanted) * decay


def advance_state(
    state: VehicleState,
    mean: Twist2,
    end: Twist2,
    wheels: Twist2,
    dt_s: float,
    errors: WheelErrors,
    slip: tuple[float, float],
    steering: tuple[float, float] = (0.0, 0.0),
) -> VehicleState:
    """Return the state after a step with a mean twist, as driven and as the wheels saw it."""
    length_m = math.hypot(mean.forward_mps, mean.left_mps) * dt_s
    root_m = math.sqrt(length_m)
    forward_m = wheels.forward_mps * dt_s * (1.0 + errors.scale) + slip[0] * errors.slip_m * root_m
    left_m = wheels.left_mps * dt_s * (1.0 + errors.scale)
    turn_rad = wheels.yaw_radps * dt_s * (1.0 + errors.turn_scale) + slip[1] * errors.slip_rad * root_m
    before = state.twist
    return VehicleState(
        pose_map_base=state.pose_map_base @ mean.after(dt_s),
        twist=end,
        front_rad=steering[0],
        rear_rad=steering[1],
        travelled_m=state.travelled_m + length_m,
        forward_mps2=(end.forward_mps - before.forward_mps) / dt_s - end.left_mps * end.yaw_radps,
        left_mps2=(end.left_mps - before.left_mps) / dt_s + end.forward_mps * end.yaw_radps,
        yaw_radps2=(end.yaw_radps - before.yaw_radps) / dt_s,
        pose_start_wheels=state.pose_start_wheels @ Pose2.exp(forward_m, left_m, turn_rad),
        wheels_m=state.wheels_m + forward_m,
    )
