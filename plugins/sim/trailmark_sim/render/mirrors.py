"""Flat mirrors: a polished floor, the glass of a refrigerator.

What a flat mirror shows is what an eye would see from behind it, as far behind as the eye is before it, if nothing
stood behind the mirror. So a picture with a mirror is two pictures of the same rays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Bools, Float32s, Floats
from trailmark_sim.render.shapes import RECTANGLE, Shape
from trailmark_sim.render.viewpoints import Viewpoints

__all__ = ["Mirror", "mirrors_of"]

#: Shapes that lie in one plane to this are one mirror, and do not stand behind it [m].
_SAME_M = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Mirror:
    """A plane that mirrors, where some shapes lie in it.

    Attributes
    ----------
    shapes : tuple of int
        Numbers of the rectangles in the plane that mirror.
    normal : (3,) float64
        Unit vector away from the mirror, to the side from which it is seen.
    offset_m : float
        ``normal @ point`` of its points [m].
    reflectance : float
        Share of the light that it mirrors where it is met squarely.
    is_behind : (P,) bool
        Which shapes of the scene stand behind it, and are not mirrored.
    """

    shapes: tuple[int, ...]
    normal: Floats
    offset_m: float
    reflectance: float
    is_behind: Bools

    def reflect(self, points: Viewpoints) -> Viewpoints:
        """Return from where the mirrored scene is seen; its axes are mirrored too, so that rays stay the same."""
        flip = np.eye(3) - 2.0 * np.outer(self.normal, self.normal)
        away_m = points.eyes @ self.normal - self.offset_m
        return Viewpoints(flip @ points.rotations, points.eyes - 2.0 * away_m[:, None] * self.normal)

    def share(self, cosines: Float32s) -> Float32s:
        """Return the share of the light that is mirrored at a slant: Schlick's approximation of Fresnel's equations.

        Parameters
        ----------
        cosines : float32 array
            Of the angle between rays and the normal.
        """
        straight = np.float32(self.reflectance)
        return straight + (np.float32(1.0) - straight) * (np.float32(1.0) - cosines) ** 5


def mirrors_of(shapes: Sequence[Shape], reflectances: Sequence[float]) -> tuple[Mirror, ...]:
    """Return the mirrors of a scene: rectangles in one plane, with one reflectance, are one.

    Parameters
    ----------
    shapes : sequence of Shape
        All that stands.
    reflectances : sequence of float
        Of each shape; 0 is no mirror.

    Raises
    ------
    ValueError
        If a shape mirrors that is not flat.
    """
    planes: dict[tuple[float, ...], list[int]] = {}
    for number, (shape, reflectance) in enumerate(zip(shapes, reflectances, strict=True)):
        if reflectance == 0.0:
            continue
        if shape.kind != RECTANGLE:
            raise ValueError(f"shape {number} is to mirror and is not flat: only rectangles can")
        normal = shape.frame[0]
        plane = np.round(np.array([*normal, normal @ shape.origin]) / _SAME_M).tolist()
        planes.setdefault((*plane, reflectance), []).append(number)
    return tuple(_mirror(shapes, numbers, key[-1]) for key, numbers in planes.items())


def _mirror(shapes: Sequence[Shape], numbers: Sequence[int], reflectance: float) -> Mirror:
    first = shapes[numbers[0]]
    normal = first.frame[0]
    offset_m = float(normal @ first.origin)
    is_behind = np.array([_highest_m(shape, normal) <= offset_m + _SAME_M for shape in shapes])
    return Mirror(tuple(numbers), normal, offset_m, reflectance, is_behind)


def _highest_m(shape: Shape, normal: Floats) -> float:
    """Return how far a shape reaches along a direction at most; of what is round, the sphere around it [m]."""
    if shape.kind != RECTANGLE:
        return float(normal @ shape.centre) + shape.radius_m
    sides = [row / (row @ row) for row in shape.frame[1:]]
    return float(normal @ shape.origin) + sum(max(0.0, float(normal @ side)) for side in sides)
