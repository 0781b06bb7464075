"""The three shapes a world is made of, each as a frame of its own in which it is a unit shape.

A point of a ray is ``q + t m`` with ``q = frames @ (eye - origin)`` and ``m = frames @ direction``; in it

- a rectangle is ``l0 = 0`` with ``l1, l2`` in [0, 1], and `l0` is the distance before its face;
- a cylinder is ``l1^2 + l2^2 = 1`` with ``l0`` in [0, 1], closed at its top;
- an ellipsoid is ``l0^2 + l1^2 + l2^2 = 1``; `l0` points up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Pose2

__all__ = [
    "CYLINDER",
    "ELLIPSOID",
    "RECTANGLE",
    "Shape",
    "box_sides",
    "cylinder",
    "ellipsoid",
    "move",
    "rectangle",
]

RECTANGLE, CYLINDER, ELLIPSOID = 0, 1, 2
Triple = Sequence[float] | Floats


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """One shape.

    Attributes
    ----------
    kind : int
        `RECTANGLE`, `CYLINDER` or `ELLIPSOID`.
    frame : (3, 3) float64
        Rows take a vector of the map to the shape's own axes [1/m; the first row of a rectangle: 1].
    origin : (3,) float64
        Where those axes start [m].
    centre : (3,) float64
        Middle of a sphere around it [m].
    radius_m : float
        Radius of that sphere [m].
    size_m : (float, float)
        Length of the surface along u and v [m].
    """

    kind: int
    frame: Floats
    origin: Floats
    centre: Floats
    radius_m: float
    size_m: tuple[float, float]


def rectangle(corner: Triple, along: Triple, up: Triple) -> Shape:
    """Return a rectangle from its lower left corner, as seen from before its face; ``along x up`` faces the viewer.

    Raises
    ------
    ValueError
        If the two sides are not at right angles or have no length.
    """
    origin, a, b = (np.asarray(v, dtype=np.float64) for v in (corner, along, up))
    width, height = math.hypot(*a), math.hypot(*b)
    if not (width > 0.0 and height > 0.0) or abs(float(a @ b)) > 1e-9 * width * height:
        raise ValueError(f"the sides of a rectangle are at right angles and longer than 0, not {along} and {up}")
    normal = np.cross(a, b) / (width * height)
    frame = np.stack([normal, a / width**2, b / height**2])
    return Shape(RECTANGLE, frame, origin, origin + (a + b) / 2.0, math.hypot(width, height) / 2.0, (width, height))


def box_sides(middle: tuple[float, float, float], size: tuple[float, float, float], yaw_rad: float) -> list[Shape]:
    """Return the sides of a box that stands at height ``middle[2]``: front (along the yaw), back, left, right, top."""
    length, width, height = size
    forward = np.array([math.cos(yaw_rad), math.sin(yaw_rad), 0.0])
    left = np.array([-forward[1], forward[0], 0.0])
    base, up = np.array(middle), np.array([0.0, 0.0, height])
    sides = []
    for out, deep, along, wide in ((forward, length, left, width), (left, width, -forward, length)):
        for sign in (1.0, -1.0):
            corner = base + sign * out * deep / 2.0 - sign * along * wide / 2.0
            sides.append(rectangle(corner, sign * along * wide, up))
    corner = base + up - forward * length / 2.0 + left * width / 2.0
    return [*sides, rectangle(corner, -left * width, forward * length)]


def cylinder(x: float, y: float, z: float, radius_m: float, height_m: float, yaw_rad: float = 0.0) -> Shape:
    """Return an upright cylinder that stands at height `z`; its texture begins behind, seen along the yaw."""
    cos, sin = math.cos(yaw_rad) / radius_m, math.sin(yaw_rad) / radius_m
    frame = np.array([[0.0, 0.0, 1.0 / height_m], [cos, sin, 0.0], [-sin, cos, 0.0]])
    centre = np.array([x, y, z + height_m / 2.0])
    size_m = (2.0 * math.pi * radius_m, height_m)
    return Shape(CYLINDER, frame, np.array([x, y, z]), centre, math.hypot(radius_m, height_m / 2.0), size_m)


def ellipsoid(centre: Sequence[float], semi_axes_m: Sequence[float], yaw_rad: float = 0.0) -> Shape:
    """Return an ellipsoid with one axis upright, the others turned by the yaw."""
    a, b, c = semi_axes_m
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    frame = np.array([[0.0, 0.0, 1.0 / c], [cos / a, sin / a, 0.0], [-sin / b, cos / b, 0.0]])
    middle = np.asarray(centre, dtype=np.float64)
    return Shape(ELLIPSOID, frame, middle, middle, max(a, b, c), (math.pi * (a + b), math.pi * c / 2.0))


def move(shape: Shape, pose_map_part: Pose2) -> Shape:
    """Return a shape of a part that stands at a pose, in the map."""
    cos, sin = math.cos(pose_map_part.theta), math.sin(pose_map_part.theta)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    at = np.array([pose_map_part.x, pose_map_part.y, 0.0])
    origin, centre = turn @ shape.origin + at, turn @ shape.centre + at
    return replace(shape, frame=shape.frame @ turn.T, origin=origin, centre=centre)
