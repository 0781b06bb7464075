"""Vehicles: pure functions from a state and a command to the next state."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from trailmark.commands import Command
from trailmark.geometry import Pose2, Twist2

__all__ = ["Vehicle", "VehicleState"]


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
        Actual steering angles, counter-clockwise; zero for vehicles that do not steer [rad].
    travelled_m : float
        Length of the way driven so far; grows also backwards [m].
    forward_mps2, left_mps2 : float
        Acceleration in base axes, the turning included [m/s^2].
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
    pose_start_wheels: Pose2 = Pose2()
    wheels_m: float = 0.0


class Vehicle(ABC):
    """A vehicle: frozen numbers and a pure step."""

    length_m: float
    width_m: float

    @property
    @abstractmethod
    def accepts(self) -> frozenset[type[Command]]:
        """The commands it understands."""

    @abstractmethod
    def step(
        self, state: VehicleState, command: Command, dt_s: float, slip: tuple[float, float] = (0.0, 0.0)
    ) -> VehicleState:
        """Return the state `dt_s` later, the command held; `slip` are two standard normal numbers."""
