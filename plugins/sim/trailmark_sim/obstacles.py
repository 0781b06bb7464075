"""What a vehicle can run into on the ground course."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from trailmark.geometry import Pose2

__all__ = ["Pole", "touched_pole"]


@dataclass(frozen=True, slots=True)
class Pole:
    """A round pole.

    Attributes
    ----------
    name : str
        What it is called when something touches it.
    x, y : float
        Where it stands in the map [m].
    radius_m : float
        How thick it is [m].
    """

    name: str
    x: float
    y: float
    radius_m: float


def touched_pole(poles: Sequence[Pole], length_m: float, width_m: float, pose: Pose2) -> str | None:
    """Return the name of the first pole that a vehicle at a pose touches, or None.

    The vehicle is a rectangle with base in its middle.
    """
    to_base = pose.inverse()
    for pole in poles:
        seen = to_base @ Pose2(pole.x, pole.y)
        beyond_x = max(0.0, abs(seen.x) - length_m / 2.0)
        beyond_y = max(0.0, abs(seen.y) - width_m / 2.0)
        if beyond_x * beyond_x + beyond_y * beyond_y < pole.radius_m * pole.radius_m:
            return pole.name
    return None
