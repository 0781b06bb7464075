"""What shapes look like, and the row that the kernels have of each."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from trailmark.arrays import Int32s
from trailmark_sim.render.atlas import Atlas
from trailmark_sim.render.shapes import RECTANGLE, Shape

__all__ = ["Colour", "Surface", "surface_row"]

Colour = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Surface:
    """What a shape looks like.

    Attributes
    ----------
    texture : int
        Number of the texture, from `SceneBuilder.texture`; 0 is plain white.
    repeat : (float, float)
        How often the texture fits along u and v.
    tint : (float, float, float)
        Multiplies the texture's reflectance: red, green, blue.
    emission : float
        Light that it sends out by itself: a lamp, a window, a screen.
    shine : float
        Share of the light that is mirrored; from 0.2 on a depth sensor sees holes.
    mirror : float
        Share of the light that it mirrors as a polished plane, where it is met squarely; only rectangles can.
    is_floor : bool
        People cast their shadows on it.
    blocks_light : bool
        False for lamps and window panes.
    """

    texture: int = 0
    repeat: tuple[float, float] = (1.0, 1.0)
    tint: Colour = (1.0, 1.0, 1.0)
    emission: float = 0.0
    shine: float = 0.0
    mirror: float = 0.0
    is_floor: bool = False
    blocks_light: bool = True


def surface_row(shape: Shape, surface: Surface, patch: Int32s, atlas: Atlas) -> tuple[Any, ...]:
    """Return a `SURFACE_ROW`; the patch says where the light begins, and how many columns and rows it has."""
    size = atlas.sizes[surface.texture]
    along = surface.repeat[0] * size["width"] / shape.size_m[0]
    up = surface.repeat[1] * size["height"] / shape.size_m[1]
    # The geometric mean of both directions: neither is blurred nor aliased much.
    density = math.sqrt(along * up) if shape.kind == RECTANGLE else max(along, up)
    look = (*surface.repeat, *surface.tint, surface.emission, surface.shine, density)
    return (*look, surface.texture, *patch, surface.is_floor)
