"""The kernels that compute the light at places: lamps and sun with their shadows, and how much of the sky is seen."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from trailmark.arrays import AnyArray, Bools, Floats
from trailmark.kernels import kernel
from trailmark_sim.render.shapes import ELLIPSOID, RECTANGLE

__all__ = ["Blockers", "LightPlaces", "LightSources", "light_places"]

#: Light is looked for this far before a surface, so that a surface does not shade itself [m].
_LIFT_M = 2e-3
_NEVER = 1e30
_kernel = kernel(error_model="numpy")


class Blockers(NamedTuple):
    """All P shapes of a scene, as in `Scene`; those that are not solid cast no shadow.

    Attributes
    ----------
    kinds : (P,) int8
    frames : (P, 3, 3) float64
    origins : (P, 3) float64
        Of the shapes; see `Shape`.
    spheres : (P, 4) float64
        Bounding spheres: centre and radius [m].
    solid : (P,) bool
        Which cast shadows.
    n_fixed : int
        Shapes from here on move; they are lit as if they stood in the open.
    """

    kinds: AnyArray
    frames: Floats
    origins: Floats
    spheres: Floats
    solid: Bools
    n_fixed: int


class LightPlaces(NamedTuple):
    """N places on surfaces that are to be lit.

    Attributes
    ----------
    positions : float64 array
        (N, 3) in the map [m].
    normals : float64 array
        (N, 3), of length one.
    owners : array
        (N,), number of the shape that each lies on.
    """

    positions: Floats
    normals: Floats
    owners: AnyArray


class LightSources(NamedTuple):
    """All light of a scene.

    Attributes
    ----------
    lamps, facings, powers : (L, 3) float64
        Points that shine: place [m], unit vector along which they do, red, green and blue.
    sun, sunlight : (3,) float64
        Unit vector to the sun (zeros: there is none), and its red, green and blue.
    ambient : (3,) float64
        Light from everywhere.
    reach_m : float
        Things further than this take no ambient light away [m].
    openings : (D, 3) float64
        Directions about +z along which a place looks for the ambient light.
    """

    lamps: Floats
    facings: Floats
    powers: Floats
    sun: Floats
    sunlight: Floats
    ambient: Floats
    reach_m: float
    openings: Floats


@_kernel
def light_places(
    first: int, last: int, places: LightPlaces, blockers: Blockers, sources: LightSources, light: AnyArray
) -> None:
    """Write the light at places `first` to `last` into `light` (N, 3) float32."""
    n_shapes, spheres = blockers.kinds.shape[0], blockers.spheres
    every, near = np.empty(n_shapes, np.int64), np.empty(n_shapes, np.int64)
    start, way = np.empty(3), np.empty(3)
    ambient, reach_m, sun = sources.ambient, sources.reach_m, sources.sun
    for place in range(first, last):
        x, n, owner = places.positions[place], places.normals[place], places.owners[place]
        stands_open = owner >= blockers.n_fixed
        n_every, n_near = 0, 0
        for p in range(n_shapes):
            if p == owner or not blockers.solid[p] or stands_open:
                continue
            every[n_every] = p
            n_every += 1
            apart = 0.0
            for c in range(3):
                apart += (spheres[p, c] - x[c]) ** 2
            if apart < (spheres[p, 3] + reach_m) ** 2:
                near[n_near] = p
                n_near += 1
        for c in range(3):
            start[c] = x[c] + _LIFT_M * n[c]
        openness = _openness(start, n, way, near[:n_near], blockers, sources)
        for c in range(3):
            light[place, c] = ambient[c] * openness * (0.85 + 0.15 * n[2])
        _add_lamps(light[place], start, n, way, every[:n_every], blockers, sources)
        facing = n[0] * sun[0] + n[1] * sun[1] + n[2] * sun[2]
        if facing > 0.0 and not _is_blocked(start, sun, _NEVER, every[:n_every], blockers):
            for c in range(3):
                light[place, c] += facing * sources.sunlight[c]


@_kernel
def _add_lamps(
    light: AnyArray,
    start: AnyArray,
    n: AnyArray,
    way: AnyArray,
    candidates: AnyArray,
    blockers: Blockers,
    sources: LightSources,
) -> None:
    for k in range(sources.lamps.shape[0]):
        square = 0.0
        for c in range(3):
            way[c] = sources.lamps[k, c] - start[c]
            square += way[c] * way[c]
        away = math.sqrt(square)
        here, there = 0.0, 0.0
        for c in range(3):
            way[c] /= away
            here += way[c] * n[c]
            there -= way[c] * sources.facings[k, c]
        if here <= 0.0 or there <= 0.0:
            continue
        if not _is_blocked(start, way, away - 0.05, candidates, blockers):
            for c in range(3):
                light[c] += sources.powers[k, c] * here * there / max(square, 0.1)


@_kernel
def _openness(
    start: AnyArray, n: AnyArray, way: AnyArray, candidates: AnyArray, blockers: Blockers, sources: LightSources
) -> Any:
    """Return the share of the ambient light that reaches a place."""
    if candidates.shape[0] == 0:
        return 1.0
    openings, reach_m = sources.openings, sources.reach_m
    # Two axes beside the normal: the one that is least along it comes first.
    ax, ay, az = (0.0, 0.0, 1.0) if abs(n[2]) < 0.9 else (1.0, 0.0, 0.0)
    bx, by, bz = ay * n[2] - az * n[1], az * n[0] - ax * n[2], ax * n[1] - ay * n[0]
    length = math.sqrt(bx * bx + by * by + bz * bz)
    bx, by, bz = bx / length, by / length, bz / length
    cx, cy, cz = n[1] * bz - n[2] * by, n[2] * bx - n[0] * bz, n[0] * by - n[1] * bx
    total = 0.0
    for k in range(openings.shape[0]):
        o = openings[k]
        way[0] = o[0] * bx + o[1] * cx + o[2] * n[0]
        way[1] = o[0] * by + o[1] * cy + o[2] * n[1]
        way[2] = o[0] * bz + o[1] * cz + o[2] * n[2]
        t = reach_m
        for i in range(candidates.shape[0]):
            t = min(t, _range_to(start, way, candidates[i], blockers))
        total += t / reach_m
    return 0.15 + 0.85 * total / openings.shape[0]


@_kernel
def _is_blocked(start: AnyArray, way: AnyArray, away: float, candidates: AnyArray, blockers: Blockers) -> bool:
    for i in range(candidates.shape[0]):  # noqa: SIM110, numba knows no any()
        if _range_to(start, way, candidates[i], blockers) < away:
            return True
    return False


@_kernel
def _range_to(start: AnyArray, way: AnyArray, p: int, blockers: Blockers) -> Any:
    """Return the range to one shape, from either side."""
    kinds, origins, spheres = blockers.kinds, blockers.origins, blockers.spheres
    along, square = 0.0, 0.0
    for c in range(3):
        d = spheres[p, c] - start[c]
        along += d * way[c]
        square += d * d
    radius = spheres[p, 3]
    if square - along * along > radius * radius or along < -radius:
        return _NEVER
    frame = blockers.frames[p]
    x, y, z = start[0] - origins[p, 0], start[1] - origins[p, 1], start[2] - origins[p, 2]
    q0 = frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z
    q1 = frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z
    q2 = frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z
    m0 = frame[0, 0] * way[0] + frame[0, 1] * way[1] + frame[0, 2] * way[2]
    m1 = frame[1, 0] * way[0] + frame[1, 1] * way[1] + frame[1, 2] * way[2]
    m2 = frame[2, 0] * way[0] + frame[2, 1] * way[1] + frame[2, 2] * way[2]
    if kinds[p] == RECTANGLE:
        t = -q0 / m0
        u, v = q1 + t * m1, q2 + t * m2
        return t if t > 0.0 and 0.0 <= u <= 1.0 and 0.0 <= v <= 1.0 else _NEVER
    weight = 1.0 if kinds[p] == ELLIPSOID else 0.0
    a = m1 * m1 + m2 * m2 + weight * m0 * m0
    b = q1 * m1 + q2 * m2 + weight * q0 * m0
    c0 = q1 * q1 + q2 * q2 + weight * q0 * q0 - 1.0
    t = (-b - math.sqrt(max(0.0, b * b - a * c0))) / a
    height = q0 + t * m0
    if b * b < a * c0 or not t > 0.0 or (weight == 0.0 and not 0.0 <= height <= 1.0):
        return _NEVER
    return t
