"""The kernel that finds what each ray meets first. Colours, depth and laser ranges all start here.

Shapes that lie beside the cone around some tiles are left out for all of them, and those beside the cone of one tile
for its 64 rays. These meet the others in the order of their nearest points, so that they can stop early. The loops
over rays, and over shapes, have no branches: eight or sixteen are done at once.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.kernels import kernel
from trailmark_sim.render.lanes import ints
from trailmark_sim.render.rays import LANES, RayTable
from trailmark_sim.render.records import N_BOUNDS, RayHits, SeenShapes
from trailmark_sim.render.shapes import CYLINDER, ELLIPSOID, RECTANGLE

__all__ = ["BLOCK", "NOTHING_M", "bound_shapes", "cast_tiles"]

#: Range of a ray that meets nothing [m].
NOTHING_M = np.float32(1e9)
_EPS = np.float32(1e-4)
_ZERO, _ONE, _TINY = np.float32(0.0), np.float32(1.0), np.float32(1e-30)
_F: Any = np.float32
_NEVER_M = np.float32(-1e9)

#: Shapes that are tried at once: `SeenShapes.bounds` has a multiple of so many columns.
BLOCK = 16
#: Tiles are tried together while the cone around them is narrower than 60 deg to each side: its cosine.
_NARROW = np.float32(0.5)

_kernel = kernel(error_model="numpy")


@_kernel
def cast_tiles(first: int, last: int, table: RayTable, shapes: SeenShapes, met: RayHits) -> None:
    """Find the nearest shape along every ray of the tiles `first` to `last` (without it), and write it into `met`."""
    kinds, frames, eyes, near_m = shapes.kinds, shapes.frames, shapes.eyes, shapes.near_m
    n_columns = shapes.bounds.shape[2]
    around, candidates = np.empty(n_columns, np.int32), np.empty(n_columns, np.int32)
    nearby = np.empty((N_BOUNDS, n_columns), np.float32)
    group_end, n_around = first, 0
    for tile in range(first, last):
        now = table.instants[tile]
        if tile == group_end:
            group_end, axis, cos, sin = _group(tile, last, table)
            n_around = _cull(around, axis, cos, sin, shapes.bounds[now], n_columns)
            for k in range(-(-n_around // BLOCK) * BLOCK):
                column = around[min(k, n_around - 1)]
                for c in range(N_BOUNDS):
                    nearby[c, k] = shapes.bounds[now, c, column]
        tile_axis, spread = table.axes[tile], table.spread[tile]
        n_candidates = _cull(
            candidates, (tile_axis[0], tile_axis[1], tile_axis[2]), spread[0], spread[1], nearby, n_around
        )
        best, hit, ray = met.ranges_m[tile], met.shapes[tile], table.rays[tile]
        for lane in range(LANES):
            best[lane] = NOTHING_M
            hit[lane] = -1
        for n in range(n_candidates):
            p = shapes.order[around[candidates[n]]]
            if near_m[p] > _farthest(best.view(np.int32)):
                break
            if kinds[p] == RECTANGLE:
                _meet_rectangle(best, hit, ray, p, frames[now, p], eyes[now, p])
            elif kinds[p] == CYLINDER:
                _meet_cylinder(best, hit, ray, p, frames[now, p], eyes[now, p])
            elif kinds[p] == ELLIPSOID:
                _meet_ellipsoid(best, hit, ray, p, frames[now, p], eyes[now, p])


@_kernel
def _group(tile: int, last: int, table: RayTable) -> tuple[int, tuple[Any, Any, Any], Any, Any]:
    """Return where the group of tiles ends that are seen at one instant in a narrow cone, and that cone.

    The cone: its axis, and cosine and sine of half its opening.
    """
    axes, spread, instants = table.axes, table.spread, table.instants
    end, axis, cos, sin = tile + 1, (axes[tile, 0], axes[tile, 1], axes[tile, 2]), spread[tile, 0], spread[tile, 1]
    for size in (8, 4, 2):
        n = min(last, tile + size)
        if n - tile < 2 or instants[n - 1] != instants[tile]:
            continue
        x, y, z = _ZERO, _ZERO, _ZERO
        for k in range(tile, n):
            x, y, z = x + axes[k, 0], y + axes[k, 1], z + axes[k, 2]
        per_length = _ONE / math.sqrt(x * x + y * y + z * z)
        x, y, z = x * per_length, y * per_length, z * per_length
        narrowest, widest = _ONE, _ZERO
        for k in range(tile, n):
            a, b, c = axes[k, 0], axes[k, 1], axes[k, 2]
            px, py, pz = y * c - z * b, z * a - x * c, x * b - y * a
            apart_cos, apart_sin = x * a + y * b + z * c, math.sqrt(px * px + py * py + pz * pz)
            cone_cos = apart_cos * spread[k, 0] - apart_sin * spread[k, 1]
            if cone_cos < narrowest:
                narrowest, widest = cone_cos, apart_sin * spread[k, 0] + apart_cos * spread[k, 1]
        if narrowest > _NARROW:
            return n, (x, y, z), narrowest, widest
    return end, axis, cos, sin


@_kernel
def _cull(kept: AnyArray, axis: tuple[Any, Any, Any], cos: Any, sin: Any, bounds: AnyArray, n: int) -> int:
    """Write which of `n` columns of `SeenShapes.bounds` reach into a cone, and return how many."""
    ax, ay, az = axis
    is_outside = ints()
    n_kept = 0
    for first in range(0, n, BLOCK):
        block = bounds[:, first : first + BLOCK]
        for k in range(BLOCK):
            x, y, z, radius = block[0, k], block[1, k], block[2, k], block[3, k]
            along = x * ax + y * ay + z * az
            across = math.sqrt(max(_ZERO, x * x + y * y + z * z - along * along))
            is_beyond = (across * cos - along * sin > radius) | (along * cos + across * sin < -radius)
            # A rectangle is met only within four half-spaces that its edges and the eye span.
            is_beyond |= block[4, k] * ax + block[5, k] * ay + block[6, k] * az < -sin
            is_beyond |= block[7, k] * ax + block[8, k] * ay + block[9, k] * az < -sin
            is_beyond |= block[10, k] * ax + block[11, k] * ay + block[12, k] * az < -sin
            is_beyond |= block[13, k] * ax + block[14, k] * ay + block[15, k] * az < -sin
            is_outside[k] = 1 if is_beyond else 0
        for k in range(min(BLOCK, n - first)):
            kept[n_kept] = first + k
            n_kept += 1 - is_outside[k]
    return n_kept


@_kernel
def _farthest(best: AnyArray) -> Any:
    """Return the longest range; the bits of ranges stand in the order of the ranges, and are compared many at once."""
    farthest = best[0]
    for lane in range(LANES):
        farthest = np.int32(max(farthest, best[lane]))
    return np.int32(farthest).view(np.float32)


@_kernel
def _meet_rectangle(best: AnyArray, hit: AnyArray, ray: AnyArray, p: int, m: AnyArray, q: AnyArray) -> None:
    number = np.int32(p)
    for lane in range(LANES):
        dx, dy, dz = ray[0, lane], ray[1, lane], ray[2, lane]
        t = -q[0] / (m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz)
        u = q[1] + t * (m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz)
        v = q[2] + t * (m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz)
        meets = (t > _EPS) & (t < best[lane]) & (u >= _ZERO) & (u <= _ONE) & (v >= _ZERO) & (v <= _ONE)
        best[lane] = t if meets else best[lane]
        hit[lane] = number if meets else hit[lane]


@_kernel
def _meet_cylinder(best: AnyArray, hit: AnyArray, ray: AnyArray, p: int, m: AnyArray, q: AnyArray) -> None:
    number = np.int32(p)
    c = q[1] * q[1] + q[2] * q[2] - _ONE
    for lane in range(LANES):
        dx, dy, dz = ray[0, lane], ray[1, lane], ray[2, lane]
        m0 = m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz
        m1 = m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz
        m2 = m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz
        a = m1 * m1 + m2 * m2
        b = q[1] * m1 + q[2] * m2
        t = (-b - np.sqrt(b * b - a * c)) / a  # NaN where it passes by: no comparison holds
        height = q[0] + t * m0
        meets = (t > _EPS) & (t < best[lane]) & (height >= _ZERO) & (height <= _ONE)
        top = (_ONE - q[0]) / m0
        x, y = q[1] + top * m1, q[2] + top * m2
        meets_top = (m0 < _ZERO) & (top > _EPS) & (top < best[lane]) & (x * x + y * y <= _ONE)
        t = top if meets_top else t
        meets = meets | meets_top
        best[lane] = t if meets else best[lane]
        hit[lane] = number if meets else hit[lane]


@_kernel
def _meet_ellipsoid(best: AnyArray, hit: AnyArray, ray: AnyArray, p: int, m: AnyArray, q: AnyArray) -> None:
    number = np.int32(p)
    c = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] - _ONE
    for lane in range(LANES):
        dx, dy, dz = ray[0, lane], ray[1, lane], ray[2, lane]
        m0 = m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz
        m1 = m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz
        m2 = m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz
        a = m0 * m0 + m1 * m1 + m2 * m2
        b = q[0] * m0 + q[1] * m1 + q[2] * m2
        t = (-b - np.sqrt(b * b - a * c)) / a
        meets = (t > _EPS) & (t < best[lane])
        best[lane] = t if meets else best[lane]
        hit[lane] = number if meets else hit[lane]


@_kernel
def bound_shapes(kinds: AnyArray, frames: AnyArray, eyes: AnyArray, spheres: AnyArray, order: AnyArray) -> AnyArray:
    """Return the `SeenShapes.bounds` of shapes with spheres (G, P, 4)."""
    n_instants, n = len(frames), len(order)
    bounds = np.zeros((n_instants, N_BOUNDS, -(-n // BLOCK) * BLOCK), np.float32)
    for now in range(n_instants):
        for k in range(n):
            p = order[k]
            m, q = frames[now, p], eyes[now, p]
            for c in range(4):
                bounds[now, c, k] = spheres[now, p, c]
            if kinds[p] != RECTANGLE:
                continue
            for side in range(4):
                # The point l1 = q1 - q0 (m1 d) / (m0 d) lies beyond 0, and before 1; and so does l2.
                axis, edge, sign = 1 + side // 2, _F(side % 2), _F(1 - 2 * (side % 2))
                a, b = sign * q[0], sign * (edge - q[axis])
                x, y, z = a * m[axis, 0] + b * m[0, 0], a * m[axis, 1] + b * m[0, 1], a * m[axis, 2] + b * m[0, 2]
                length: Any = max(_TINY, math.sqrt(x * x + y * y + z * z))
                for c, value in enumerate((x, y, z)):
                    bounds[now, 4 + 3 * side + c, k] = value / length
        for k in range(n, bounds.shape[2]):
            bounds[now, 3, k] = _NEVER_M
    return bounds
