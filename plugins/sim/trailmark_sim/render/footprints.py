"""Where rays meet a shape, and what of its texture each pixel covers there."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from trailmark.kernels import inlined_kernel, kernel
from trailmark_sim.render.lanes import Footprints
from trailmark_sim.render.records import SeenShape, TileRays
from trailmark_sim.render.shapes import CYLINDER

__all__ = ["place_flat", "place_round"]

_F: Any = np.float32
_ZERO, _HALF, _ONE, _EIGHT = _F(0.0), _F(0.5), _F(1.0), _F(8.0)
_TURN = _F(1.0 / (2.0 * math.pi))
#: Size of the texels that are read over the footprint's short side. With the four places a pixel then has 0.35 to
#: 0.5 px of blur (one standard deviation) and edges keep their place within a few hundredths of a pixel.
_TEXEL_PX = _F(0.8)


@inlined_kernel
def place_flat(tile: TileRays, n: int, shape: SeenShape, place: Footprints) -> None:
    """Write what the first `n` rays cover of a rectangle that they meet."""
    m, q = shape.frame, shape.eye
    u, v, foot_m, ax, ay, bx, by = place
    n1 = math.sqrt(m[1, 0] * m[1, 0] + m[1, 1] * m[1, 1] + m[1, 2] * m[1, 2])
    n2 = math.sqrt(m[2, 0] * m[2, 0] + m[2, 1] * m[2, 1] + m[2, 2] * m[2, 2])
    per_1, per_2 = _ONE / n1, _ONE / n2
    for lane in range(n):
        dx, dy, dz, t = tile.dx[lane], tile.dy[lane], tile.dz[lane], tile.ranges_m[lane]
        m0 = m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz
        m1 = m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz
        m2 = m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz
        u[lane], v[lane] = q[1] + t * m1, q[2] + t * m2
        short = t * tile.pixel_rad[lane]
        # The footprint is longer the more the surface leans, along the ray's shadow on it.
        stretch = min(_EIGHT, _ONE / max(_F(0.02), abs(m0)))
        a, b = m1 * per_1, m2 * per_2
        length = math.sqrt(a * a + b * b)
        is_square = length < _F(1e-3)
        per_length = _ONE / max(_F(1e-3), length)
        a, b = _ONE if is_square else a * per_length, _ZERO if is_square else b * per_length
        long = short * stretch
        ax[lane], ay[lane] = a * n1 * long, b * n2 * long
        bx[lane], by[lane] = -b * n1 * short, a * n2 * short
        foot_m[lane] = short * max(_TEXEL_PX, stretch * _F(0.25))


@kernel(error_model="numpy")
def place_round(
    tile: TileRays, n: int, shape: SeenShape, density: Any, size: tuple[Any, Any], place: Footprints
) -> None:
    """Write the same of a cylinder or an ellipsoid, whose footprints are taken as square.

    `density` and `size` are the texels of a metre and of the surface, along u and v.
    """
    m, q = shape.frame, shape.eye
    u, v, foot_m, ax, ay, bx, by = place
    for lane in range(n):
        dx, dy, dz, t = tile.dx[lane], tile.dy[lane], tile.dz[lane], tile.ranges_m[lane]
        l0 = q[0] + t * (m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz)
        l1 = q[1] + t * (m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz)
        l2 = q[2] + t * (m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz)
        u[lane] = math.atan2(l2, l1) * _TURN + _HALF
        v[lane] = l0 if shape.kind == CYLINDER else (l0 + _ONE) * _HALF
        short = t * tile.pixel_rad[lane]
        ax[lane], ay[lane], bx[lane], by[lane] = short * density / size[0], _ZERO, _ZERO, short * density / size[1]
        foot_m[lane] = short * _TEXEL_PX
