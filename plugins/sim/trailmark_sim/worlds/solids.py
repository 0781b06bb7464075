"""What a vehicle can run into: boxes and poles that stand in a room, seen from above."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Pose2
from trailmark_sim.outlines import box_outline, circle_outline
from trailmark_sim.vehicles import Vehicle

__all__ = ["Solids"]


@dataclass(frozen=True, slots=True)
class _Box:
    name: str
    pose: Pose2
    half_length_m: float
    half_width_m: float

    def corners(self) -> Floats:
        signs = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
        return np.asarray(self.pose @ (signs * (self.half_length_m, self.half_width_m)))


@dataclass
class Solids:
    """Outlines of what stands in a room; a vehicle is a rectangle with base in its middle.

    Attributes
    ----------
    west, east, south, north : float
        Walls of the room [m].
    """

    west: float
    east: float
    south: float
    north: float
    _boxes: list[_Box] = field(default_factory=list)
    _poles: list[tuple[str, float, float, float]] = field(default_factory=list)

    @property
    def area(self) -> tuple[float, float, float, float]:
        """West, east, south and north wall [m]."""
        return self.west, self.east, self.south, self.north

    def box(self, name: str, x: float, y: float, length_m: float, width_m: float, yaw_rad: float = 0.0) -> None:
        """Add a box, `length_m` along its yaw."""
        self._boxes.append(_Box(name, Pose2(x, y, yaw_rad), length_m / 2.0, width_m / 2.0))

    def pole(self, name: str, x: float, y: float, radius_m: float) -> None:
        """Add something round."""
        self._poles.append((name, x, y, radius_m))

    def outlines(self) -> tuple[Floats, ...]:
        """Return the walls of the room and everything in it as closed lines, (N, 2) each [m]."""
        walls = box_outline(
            Pose2((self.west + self.east) / 2.0, (self.south + self.north) / 2.0),
            self.east - self.west,
            self.north - self.south,
        )
        boxes = (box_outline(box.pose, 2.0 * box.half_length_m, 2.0 * box.half_width_m) for box in self._boxes)
        return (walls, *boxes, *(circle_outline(x, y, radius) for _, x, y, radius in self._poles))

    def touched(self, vehicle: Vehicle, pose: Pose2) -> str | None:
        """Return what the vehicle touches at a pose, or None."""
        body = _Box("", pose, vehicle.length_m / 2.0, vehicle.width_m / 2.0)
        x, y = body.corners().T
        if x.min() < self.west or x.max() > self.east or y.min() < self.south or y.max() > self.north:
            return "a wall"
        for name, px, py, radius in self._poles:
            seen = pose.inverse() @ Pose2(px, py)
            beyond = (max(0.0, abs(seen.x) - body.half_length_m), max(0.0, abs(seen.y) - body.half_width_m))
            if math.hypot(*beyond) < radius:
                return name
        return next((box.name for box in self._boxes if _overlap(body, box)), None)


def _overlap(a: _Box, b: _Box) -> bool:
    """Return whether two rectangles overlap: no side of either lies between them."""
    for one, other in ((a, b), (b, a)):
        seen = one.pose.inverse() @ other.corners()
        low, high = seen.min(axis=0), seen.max(axis=0)
        half = (one.half_length_m, one.half_width_m)
        if any(low[n] >= half[n] or high[n] <= -half[n] for n in (0, 1)):
            return False
    return True
