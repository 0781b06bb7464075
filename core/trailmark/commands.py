"""Commands of a controller to a robot."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Command", "Steer4WS", "Stop", "Velocity"]


@dataclass(frozen=True, slots=True)
class Steer4WS:
    """Steer a vehicle whose front and rear wheels turn separately.

    Attributes
    ----------
    front_rad, rear_rad : float
        Steering angles, counter-clockwise positive [rad].
    speed_mps : float
        Speed along the vehicle's x axis; negative drives backwards [m/s].
    """

    front_rad: float
    rear_rad: float
    speed_mps: float


@dataclass(frozen=True, slots=True)
class Velocity:
    """Drive with a velocity in the robot's own axes (differential drives ignore `left_mps`).

    Attributes
    ----------
    forward_mps, left_mps : float
        Velocity along x and y of the robot; negative `forward_mps` drives backwards [m/s].
    yaw_radps : float
        Yaw rate, counter-clockwise [rad/s].
    """

    forward_mps: float
    left_mps: float = 0.0
    yaw_radps: float = 0.0


@dataclass(frozen=True, slots=True)
class Stop:
    """Stand still. With `done` the task is finished and the run ends; without, it may go on.

    Attributes
    ----------
    reason : str
        Why, in words for the person who watches.
    done : bool
        True when the goal is reached: the run ends.
    """

    reason: str
    done: bool = False


Command = Steer4WS | Velocity | Stop
