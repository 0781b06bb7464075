"""The kernel that finds what each ray meets first. Colours, depth and laser ranges all start here.

A tile of 64 rays meets the shapes in the order of their nearest points, so that it can stop early. The loops over
its rays have no branches: eight or sixteen rays are done at once.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.kernels import kernel
from trailmark_sim.render.rays import LANES, RayTable
from trailmark_sim.render.records import RayHits, SeenShapes
from trailmark_sim.render.shapes import CYLINDER, ELLIPSOID, RECTANGLE

__all__ = ["NOTHING_M", "cast_tiles"]

#: Range of a ray that meets nothing [m].
NOTHING_M = np.float32(1e9)
_EPS = np.float32(1e-4)
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)

_kernel = kernel(error_model="numpy")


@_kernel
def cast_tiles(first: int, last: int, table: RayTable, shapes: SeenShapes, met: RayHits) -> None:
    """Find the nearest shape along every ray of the tiles `first` to `last` (without it), and write it into `met`."""
    kinds, frames, eyes, near_m = shapes.kinds, shapes.frames, shapes.eyes, shapes.near_m
    candidates = np.empty(shapes.order.shape[0], np.int32)
    for tile in range(first, last):
        now = table.instants[tile]
        n_candidates = _cull(candidates, table.axes[tile], table.spread[tile], shapes.spheres[now], shapes.order)
        best, hit, ray = met.ranges_m[tile], met.shapes[tile], table.rays[tile]
        for lane in range(LANES):
            best[lane] = NOTHING_M
            hit[lane] = -1
        for n in range(n_candidates):
            p = candidates[n]
            if n % 2 == 0 and near_m[p] > _farthest(best):
                break
            if kinds[p] == RECTANGLE:
                _meet_rectangle(best, hit, ray, p, frames[now, p], eyes[now, p])
            elif kinds[p] == CYLINDER:
                _meet_cylinder(best, hit, ray, p, frames[now, p], eyes[now, p])
            elif kinds[p] == ELLIPSOID:
                _meet_ellipsoid(best, hit, ray, p, frames[now, p], eyes[now, p])


@_kernel
def _cull(candidates: AnyArray, axis: AnyArray, spread: AnyArray, spheres: AnyArray, order: AnyArray) -> int:
    """Keep the shapes whose bounding sphere reaches into the cone of a tile."""
    cos, sin = spread[0], spread[1]
    n = 0
    for k in range(order.shape[0]):
        p = order[k]
        x, y, z, radius = spheres[p, 0], spheres[p, 1], spheres[p, 2], spheres[p, 3]
        along = x * axis[0] + y * axis[1] + z * axis[2]
        across = np.sqrt(max(_ZERO, x * x + y * y + z * z - along * along))
        is_outside = across * cos - along * sin > radius or along * cos + across * sin < -radius
        candidates[n] = p
        n += 0 if is_outside else 1
    return n


@_kernel
def _farthest(best: AnyArray) -> Any:
    farthest = best[0]
    for lane in range(LANES):
        farthest = max(farthest, best[lane])
    return farthest


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
