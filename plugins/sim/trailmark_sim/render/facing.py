"""The kernel that says how steeply each ray meets its surface, and how much that mirrors: for depth sensors."""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.kernels import kernel
from trailmark_sim.render.lanes import distinct_shapes, ints
from trailmark_sim.render.rays import LANES, RayTable
from trailmark_sim.render.records import RayHits, SeenShapes
from trailmark_sim.render.shapes import CYLINDER, RECTANGLE

__all__ = ["face_tiles"]

_F = np.float32
_ZERO, _ONE = _F(0.0), _F(1.0)


@kernel(error_model="numpy")
def face_tiles(
    first: int,
    last: int,
    table: RayTable,
    met: RayHits,
    shapes: SeenShapes,
    surfaces: AnyArray,
    cosines: AnyArray,
    shine: AnyArray,
) -> None:
    """Fill `cosines` and `shine` (T, 64) of some tiles; both are 0 where a ray meets nothing."""
    found = ints()
    for tile in range(first, last):
        now, hit, ray, far = table.instants[tile], met.shapes[tile], table.rays[tile], met.ranges_m[tile]
        cosine, mirrored = cosines[tile], shine[tile]
        for lane in range(LANES):
            cosine[lane], mirrored[lane] = _ZERO, _ZERO
        for k in range(distinct_shapes(hit, found)):
            p = found[k]
            if p < 0:
                continue
            m, q, own = shapes.frames[now, p], shapes.eyes[now, p], surfaces[p].shine
            if shapes.kinds[p] == RECTANGLE:
                for lane in range(LANES):
                    straight = abs(m[0, 0] * ray[0, lane] + m[0, 1] * ray[1, lane] + m[0, 2] * ray[2, lane])
                    cosine[lane] = straight if hit[lane] == p else cosine[lane]
                    mirrored[lane] = own if hit[lane] == p else mirrored[lane]
                continue
            for lane in range(LANES):
                if hit[lane] != p:
                    continue
                dx, dy, dz, t = ray[0, lane], ray[1, lane], ray[2, lane], far[lane]
                mirrored[lane] = own
                l0 = q[0] + t * (m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz)
                l1 = q[1] + t * (m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz)
                l2 = q[2] + t * (m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz)
                if shapes.kinds[p] == CYLINDER:
                    is_top = l1 * l1 + l2 * l2 < _F(0.999)
                    l0, l1, l2 = (_ONE, _ZERO, _ZERO) if is_top else (_ZERO, l1, l2)
                nx = l0 * m[0, 0] + l1 * m[1, 0] + l2 * m[2, 0]
                ny = l0 * m[0, 1] + l1 * m[1, 1] + l2 * m[2, 1]
                nz = l0 * m[0, 2] + l1 * m[1, 2] + l2 * m[2, 2]
                length = math.sqrt(nx * nx + ny * ny + nz * nz)
                cosine[lane] = abs(nx * dx + ny * dy + nz * dz) / length
