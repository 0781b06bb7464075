"""The light that reaches a surface, what it mirrors, and the sky beside it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.kernels import inlined_kernel, kernel
from trailmark_sim.interpolation import between
from trailmark_sim.render.lanes import Colours, Footprints, Taps
from trailmark_sim.render.records import SeenShape, TileRays
from trailmark_sim.render.shapes import CYLINDER, RECTANGLE

__all__ = ["darken", "mirrored_light", "read_baked_light", "show_sky"]

_F: Any = np.float32
_I: Any = np.int32
_ZERO, _HALF, _ONE, _TWO = _F(0.0), _F(0.5), _F(1.0), _F(2.0)
_TURN = _F(1.0 / (2.0 * math.pi))
_HIGHLIGHT = _F(6.0)


@inlined_kernel
def read_baked_light(
    light: AnyArray, surface: Any, is_flat: bool, n: int, place: Footprints, taps: Taps, lit: Colours
) -> None:
    """Write the baked light at `n` places, bilinear; around a round shape the columns close."""
    u, v = place.u, place.v
    _, _, wx, wy, a, b, c, d = taps
    lr, lg, lb = lit
    start, columns, rows = _I(surface.light_start), _I(surface.light_columns), _I(surface.light_rows)
    right, top = _F(columns - 1), _F(rows - 1)
    low = _ZERO if is_flat else -_ONE
    high = right if is_flat else _F(columns)
    one, zero = _I(1), _I(0)
    beyond, last_row = _I(columns - one) if is_flat else zero, _I(rows - one)
    for lane in range(n):
        x = min(high, max(low, u[lane] * _F(columns) - _HALF))
        y = min(top, max(_ZERO, v[lane] * _F(rows) - _HALF))
        fx, fy = np.floor(x), np.floor(y)
        wx[lane], wy[lane] = x - fx, y - fy
        i, j = _I(fx), _I(fy)
        j1 = _I(min(_I(j + one), last_row))
        i0 = _I(i + columns) if i < zero else i
        i0 = _I(i0 - columns) if i0 >= columns else i0
        i1 = _I(i0 + one)
        i1 = beyond if i1 >= columns else i1
        j0, j1 = _I(start + _I(j * columns)), _I(start + _I(j1 * columns))
        a[lane], b[lane], c[lane], d[lane] = _I(j0 + i0), _I(j0 + i1), _I(j1 + i0), _I(j1 + i1)
    for lane in range(n):
        wd = wx[lane] * wy[lane]
        wb, wc = wx[lane] - wd, wy[lane] - wd
        wa = _ONE - wx[lane] - wc
        ka, kb, kc, kd = np.uint64(a[lane]), np.uint64(b[lane]), np.uint64(c[lane]), np.uint64(d[lane])
        lr[lane] = wa * light[ka, 0] + wb * light[kb, 0] + wc * light[kc, 0] + wd * light[kd, 0]
        lg[lane] = wa * light[ka, 1] + wb * light[kb, 1] + wc * light[kc, 1] + wd * light[kd, 1]
        lb[lane] = wa * light[ka, 2] + wb * light[kb, 2] + wc * light[kc, 2] + wd * light[kd, 2]


@kernel(error_model="numpy")
def darken(tile: TileRays, n: int, to_map: AnyArray, shadows: AnyArray, taps: Taps, shade: AnyArray) -> None:
    """Write the share of the light that people leave on the floor."""
    x, y = taps.x, taps.y
    for lane in range(n):
        dx, dy, dz, t = tile.dx[lane], tile.dy[lane], tile.dz[lane], tile.ranges_m[lane]
        x[lane] = to_map[3, 0] + t * (to_map[0, 0] * dx + to_map[0, 1] * dy + to_map[0, 2] * dz)
        y[lane] = to_map[3, 1] + t * (to_map[1, 0] * dx + to_map[1, 1] * dy + to_map[1, 2] * dz)
    for k in range(shadows.shape[0]):
        sx, sy, per, depth = shadows[k, 0], shadows[k, 1], _ONE / (shadows[k, 2] * shadows[k, 2]), shadows[k, 3]
        for lane in range(n):
            kx, ky = x[lane] - sx, y[lane] - sy
            near = max(_ZERO, _ONE - (kx * kx + ky * ky) * per)
            shade[lane] *= _ONE - depth * near * near


@kernel(error_model="numpy")
def mirrored_light(tile: TileRays, lane: int, shape: SeenShape, to_map: AnyArray, key: AnyArray) -> Any:
    """Return what a shiny surface mirrors: a bright spot where the key light is, a paler ceiling or sky."""
    kind, m, q = shape.kind, shape.frame, shape.eye
    dx, dy, dz, t = tile.dx[lane], tile.dy[lane], tile.dz[lane], tile.ranges_m[lane]
    w0, w1, w2 = _ONE, _ZERO, _ZERO
    if kind != RECTANGLE:
        w0 = _ZERO if kind == CYLINDER else q[0] + t * (m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz)
        w1 = q[1] + t * (m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz)
        w2 = q[2] + t * (m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz)
    nx = w0 * m[0, 0] + w1 * m[1, 0] + w2 * m[2, 0]
    ny = w0 * m[0, 1] + w1 * m[1, 1] + w2 * m[2, 1]
    nz = w0 * m[0, 2] + w1 * m[1, 2] + w2 * m[2, 2]
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / length, ny / length, nz / length
    twice = _TWO * (dx * nx + dy * ny + dz * nz)
    rx, ry, rz = dx - twice * nx, dy - twice * ny, dz - twice * nz
    towards = _ZERO
    for c in range(3):
        towards += key[c] * (to_map[c, 0] * rx + to_map[c, 1] * ry + to_map[c, 2] * rz)
    up = to_map[2, 0] * rx + to_map[2, 1] * ry + to_map[2, 2] * rz
    spot = max(_ZERO, towards)
    for _ in range(5):
        spot *= spot
    return _HIGHLIGHT * spot + _HALF * max(_ZERO, up)


@kernel(error_model="numpy")
def show_sky(out: AnyArray, tile: TileRays, n: int, to_map: AnyArray, sky: AnyArray) -> None:
    """Read the sky off its picture, bilinear, for rays that meet nothing."""
    rows, columns = sky.shape[0], sky.shape[1]
    for lane in range(n):
        pixel = tile.pixels[lane]
        if pixel < 0:
            continue
        dx, dy, dz = tile.dx[lane], tile.dy[lane], tile.dz[lane]
        x = to_map[0, 0] * dx + to_map[0, 1] * dy + to_map[0, 2] * dz
        y = to_map[1, 0] * dx + to_map[1, 1] * dy + to_map[1, 2] * dz
        z = to_map[2, 0] * dx + to_map[2, 1] * dy + to_map[2, 2] * dz
        a = (math.atan2(y, x) * _TURN + _HALF) * _F(columns) - _HALF
        b = _F(math.acos(min(_ONE, max(-_ONE, z)))) * _TWO * _TURN * _F(rows) - _HALF
        b = min(_F(rows - 1), max(_ZERO, b))
        i, j = math.floor(a), int(b)
        fx, fy = a - _F(i), b - _F(j)
        i0, i1, j1 = i % columns, (i + 1) % columns, min(j + 1, rows - 1)
        for c in range(3):
            out[pixel, c] = between(sky[j, i0, c], sky[j, i1, c], sky[j1, i0, c], sky[j1, i1, c], fx, fy)
