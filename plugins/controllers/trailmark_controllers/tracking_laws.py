"""Laws of path tracking: from the place beside a path to the turn that leads back to it.

Everything is told in the sense of travel: left of the way that is driven, and turn per way that is driven, so that
the same law drives forwards and backwards. The law is that of Micaelli & Samson, "Trajectory tracking for unicycle-type
and two-steering-wheels mobile robots", INRIA research report 2097, 1993, with an approach angle ``delta(l)`` and

    V = l^2 / 2 + (theta - delta)^2 / (2 gamma),    dV/ds = l sin(delta) - (k / gamma) (theta - delta)^2 <= 0

in the coordinates of Serret and Frenet: l the offset, theta the heading relative to the path. Here
``delta = -atan(l / l0)``, ``k = 2 / l0`` and ``gamma = 1 / (4 l0^2)``, with which small offsets vanish as
``exp(-1.5 s / l0)``, critically damped; l0 is `correct_over_m`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from trailmark.commands import Steer4WS, Velocity
from trailmark.geometry import wrap_angle

__all__ = ["BesidePath", "approach_angle", "slide", "steer_both_axles", "turn_per_way"]

#: Nearer than this to the centre of a bend, the station would run ahead without limit.
_LEAST_CLEARANCE = 0.2
#: Speed that corrections are made for where it is slower [m/s].
_LEAST_SPEED_MPS = 0.05
#: Of `over_m`: with it, errors that are driven out one by one vanish as fast as those of `turn_per_way`.
_DECOUPLED = 2.0 / 3.0
#: Share of full lock with which a vehicle that steers both axles drives sideways at most.
_CRAB_SHARE = 1.0 / 3.0


@dataclass(frozen=True, slots=True)
class BesidePath:
    """A place beside a path, in the sense of travel.

    Attributes
    ----------
    lateral_m : float
        Offset to the left of the way driven [m].
    heading_rad : float
        Heading relative to the taught one, counter-clockwise [rad].
    path_in_body_rad : float
        Direction of the path, in which the robot drives, seen from its x axis (pi: it drives backwards) [rad].
    bend_per_m : float
        Taught turn of the robot per way driven, where a command given now will be followed [rad/m].
    """

    lateral_m: float
    heading_rad: float
    path_in_body_rad: float
    bend_per_m: float

    @property
    def is_backwards(self) -> bool:
        """Whether the way was taught, or is driven, with the robot looking against it."""
        return math.cos(self.path_in_body_rad + self.heading_rad) < 0.0


def approach_angle(lateral_m: float, over_m: float) -> float:
    """Return delta: the heading, relative to the path, that leads back to it [rad]."""
    return -math.atan(lateral_m / over_m)


def turn_per_way(beside: BesidePath, over_m: float) -> float:
    """Return the turn per way driven of a robot that drives along its own axis [rad/m]."""
    l, theta = beside.lateral_m, beside.heading_rad  # noqa: E741  (the paper's letter)
    delta = approach_angle(l, over_m)
    rest = wrap_angle(theta - delta)
    along = math.cos(theta) / max(_LEAST_CLEARANCE, 1.0 - l * beside.bend_per_m)
    delta_rate = -math.sin(theta) / over_m / (1.0 + (l / over_m) ** 2)
    chord = (math.sin(theta) - math.sin(delta)) / rest if abs(rest) > 1e-6 else math.cos(theta)
    k, gamma = 2.0 / over_m, 0.25 / over_m**2
    return beside.bend_per_m * along + delta_rate - gamma * l * chord - k * rest


def slide(beside: BesidePath, speed_mps: float, over_m: float) -> Velocity:
    """Return the velocity of a robot that drives any way: back to the path, and the taught heading for itself."""
    over_m *= _DECOUPLED
    course_rad = beside.path_in_body_rad + approach_angle(beside.lateral_m, over_m)
    correct_mps = max(speed_mps, _LEAST_SPEED_MPS)
    yaw_radps = beside.bend_per_m * speed_mps - beside.heading_rad * correct_mps / over_m
    return Velocity(speed_mps * math.cos(course_rad), speed_mps * math.sin(course_rad), yaw_radps)


def steer_both_axles(
    beside: BesidePath, speed_mps: float, over_m: float, *, wheelbase_m: float, limit_rad: float
) -> Steer4WS:
    """Return the steering of a vehicle whose front and rear wheels steer separately.

    Same-phase steering drives it sideways back to the path, opposite-phase steering turns it to the taught heading: two
    errors that do not know of each other. Offsets that ask for more than a third of full lock sideways are driven out
    with the heading too. In the single-track model, with base midway between the axles,
    ``tan front, tan rear = tan crab +- bend wheelbase / 2``.

    Parameters
    ----------
    beside : BesidePath
        Offset, heading error and curvature of the path.
    speed_mps : float
        Speed to drive [m/s].
    over_m : float
        Length l0 by which errors vanish, as ``exp(-1.5 s / l0)`` [m].
    wheelbase_m : float
        Distance of the axles [m].
    limit_rad : float
        Full lock [rad].

    Returns
    -------
    Steer4WS
        Front and rear angle [rad] and speed [m/s].
    """
    is_backwards = beside.is_backwards
    over_m *= _DECOUPLED
    delta = approach_angle(beside.lateral_m, over_m)
    axis_rad = wrap_angle(beside.path_in_body_rad + (math.pi if is_backwards else 0.0))
    most_rad = _CRAB_SHARE * limit_rad
    crab_rad = min(max(axis_rad + delta, -most_rad), most_rad)
    heading_rad = beside.heading_rad - (delta - min(max(delta, -most_rad), most_rad))
    bend_per_m = beside.bend_per_m - heading_rad / over_m
    same = math.tan(crab_rad)
    opposite = (-1.0 if is_backwards else 1.0) * bend_per_m * wheelbase_m / 2.0
    front_rad, rear_rad = (min(max(math.atan(same + side * opposite), -limit_rad), limit_rad) for side in (1.0, -1.0))
    return Steer4WS(front_rad, rear_rad, -speed_mps if is_backwards else speed_mps)
