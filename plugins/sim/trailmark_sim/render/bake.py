"""Light on surfaces, computed once: direct light with shadows, and how much of the surroundings each place sees."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.kernels import kernel
from trailmark_sim.render.shapes import CYLINDER, ELLIPSOID, RECTANGLE, Shape
from trailmark_sim.workers import in_bands

__all__ = ["Lamp", "Lighting", "bake_light"]

Colour = tuple[float, float, float]

_N_OPEN = 48
_ROUND_PATCH = (12, 6)
_MOST_TEXELS = 256
#: Light is looked for this far before a surface, so that a surface does not shade itself [m].
_LIFT_M = 2e-3
_NEVER = 1e30
_kernel = kernel(error_model="numpy")


@dataclass(frozen=True, slots=True)
class Lamp:
    """A level panel that shines down (or a window that shines along `facing`).

    Attributes
    ----------
    centre : (float, float, float)
        Middle [m].
    along, across : (float, float, float)
        Its two sides [m].
    facing : (float, float, float)
        Unit vector along which it shines.
    power : (float, float, float)
        Red, green, blue; a white wall at 1 m before it gets so much light.
    """

    centre: tuple[float, float, float]
    along: tuple[float, float, float]
    across: tuple[float, float, float]
    facing: tuple[float, float, float] = (0.0, 0.0, -1.0)
    power: Colour = (1.0, 1.0, 1.0)

    def samples(self) -> list[tuple[float, ...]]:
        """Return 2 x 2 points: position, facing, a quarter of the power."""
        middle, a, b = (np.asarray(v) for v in (self.centre, self.along, self.across))
        points = [middle + i * a + j * b for i in (-0.25, 0.25) for j in (-0.25, 0.25)]
        return [(*point, *self.facing, *(value / 4.0 for value in self.power)) for point in points]


@dataclass(frozen=True, slots=True)
class Lighting:
    """All light of a scene.

    Attributes
    ----------
    lamps : tuple of Lamp
        Panels and windows.
    ambient : (float, float, float)
        Light from everywhere, before corners and shelves take their share.
    sun : (float, float, float) or None
        Direction to the sun.
    sunlight : (float, float, float)
        Light on a surface that faces the sun.
    reach_m : float
        Things further than this take no ambient light away [m].
    texel_m : float
        Distance of the places where light is computed [m].
    """

    lamps: tuple[Lamp, ...] = ()
    ambient: Colour = (0.4, 0.4, 0.4)
    sun: tuple[float, float, float] | None = None
    sunlight: Colour = (0.0, 0.0, 0.0)
    reach_m: float = 1.5
    texel_m: float = 0.2

    def key(self) -> npt.NDArray[np.float64]:
        """Return the direction to the brightest light."""
        direction = np.array(self.sun or (0.2, 0.1, 1.0))
        return np.asarray(direction / np.linalg.norm(direction))


def bake_light(
    shapes: Sequence[Shape], blocks: Sequence[bool], lighting: Lighting, threads: int = 1
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]]:
    """Return the light on all shapes; those beyond `blocks` move, and are lit as if they stood in the open.

    Returns
    -------
    (N, 3) float32
        Light at every place, shape by shape, row by row from the lowest.
    (P, 3) int32
        Where the places of each shape begin, and how many columns and rows there are.
    """
    pieces, patches, at = [], np.zeros((len(shapes), 3), np.int32), 0
    for number, shape in enumerate(shapes):
        columns, rows = _grid(shape, lighting.texel_m)
        patches[number] = at, columns, rows
        pieces.append(_places(shape, columns, rows))
        at += columns * rows
    places = np.concatenate(pieces)
    owners = np.repeat(np.arange(len(shapes)), patches[:, 1] * patches[:, 2])
    light = np.empty((at, 3), np.float32)
    n_fixed = len(blocks)
    solid = np.zeros(len(shapes), np.bool_)
    solid[:n_fixed] = blocks
    scene = _arrays(shapes)
    lamps = np.array([row for lamp in lighting.lamps for row in lamp.samples()], np.float64).reshape(-1, 9)
    sun = np.array(lighting.sun if lighting.sun is not None else (0.0, 0.0, 0.0), np.float64)
    sun = np.concatenate([sun / max(1e-12, float(np.linalg.norm(sun))), lighting.sunlight])
    ambient = np.array([*lighting.ambient, lighting.reach_m])

    def work(first: int, last: int) -> None:
        rest = (solid, *scene, lamps, sun, ambient, _OPEN)
        _light_places(first, last, light, places, owners, n_fixed, *rest)

    in_bands(work, at, threads)
    return light, patches


def _grid(shape: Shape, texel_m: float) -> tuple[int, int]:
    if shape.kind != RECTANGLE:
        return _ROUND_PATCH
    columns, rows = (min(_MOST_TEXELS, max(2, math.ceil(size / texel_m))) for size in shape.size_m)
    return columns, rows


def _places(shape: Shape, columns: int, rows: int) -> npt.NDArray[np.float64]:
    """Return the places of a shape and the normals there, (rows * columns, 6)."""
    v, u = np.meshgrid((np.arange(rows) + 0.5) / rows, (np.arange(columns) + 0.5) / columns, indexing="ij")
    inverse = np.linalg.inv(shape.frame)
    if shape.kind == RECTANGLE:
        local = np.stack([np.zeros_like(u), u, v], axis=-1).reshape(-1, 3)
        normals = np.broadcast_to(shape.frame[0], local.shape)
        return np.concatenate([shape.origin + local @ inverse.T, normals], axis=1)
    angle = (u - 0.5) * 2.0 * math.pi
    height = v if shape.kind == CYLINDER else 2.0 * v - 1.0
    around = np.ones_like(u) if shape.kind == CYLINDER else np.sqrt(1.0 - height**2)
    local = np.stack([height, around * np.cos(angle), around * np.sin(angle)], axis=-1).reshape(-1, 3)
    outward = local * (0.0, 1.0, 1.0) if shape.kind == CYLINDER else local
    normals = outward @ shape.frame
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.concatenate([shape.origin + local @ inverse.T, normals], axis=1)


def _arrays(shapes: Sequence[Shape]) -> tuple[npt.NDArray[Any], ...]:
    spheres = np.array([(*shape.centre, shape.radius_m) for shape in shapes])
    kinds = np.array([shape.kind for shape in shapes], np.int8)
    return kinds, np.stack([s.frame for s in shapes]), np.stack([s.origin for s in shapes]), spheres


def _open_directions() -> npt.NDArray[np.float64]:
    """Return directions about +z, spread like the light that a matt surface takes. The same everywhere: no blotches."""
    n = np.arange(_N_OPEN) + 0.5
    sine, turn = np.sqrt(n / _N_OPEN), n * math.pi * (3.0 - math.sqrt(5.0))
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), np.sqrt(1.0 - sine**2)], axis=1)


_OPEN = _open_directions()


@_kernel
def _light_places(
    first: int,
    last: int,
    light: npt.NDArray[Any],
    places: npt.NDArray[Any],
    owners: npt.NDArray[Any],
    n_fixed: int,
    solid: npt.NDArray[Any],
    kinds: npt.NDArray[Any],
    frames: npt.NDArray[Any],
    origins: npt.NDArray[Any],
    spheres: npt.NDArray[Any],
    lamps: npt.NDArray[Any],
    sun: npt.NDArray[Any],
    ambient: npt.NDArray[Any],
    opening: npt.NDArray[Any],
) -> None:
    """Compute the light at places `first` to `last`."""
    every, near = np.empty(kinds.shape[0], np.int64), np.empty(kinds.shape[0], np.int64)
    start, way = np.empty(3), np.empty(3)
    for place in range(first, last):
        x, n, owner = places[place, :3], places[place, 3:], owners[place]
        stands_open = owner >= n_fixed
        n_every, n_near = 0, 0
        for p in range(kinds.shape[0]):
            if p == owner or not solid[p] or stands_open:
                continue
            every[n_every] = p
            n_every += 1
            apart = 0.0
            for c in range(3):
                apart += (spheres[p, c] - x[c]) ** 2
            if apart < (spheres[p, 3] + ambient[3]) ** 2:
                near[n_near] = p
                n_near += 1
        for c in range(3):
            start[c] = x[c] + _LIFT_M * n[c]
        scene = (kinds, frames, origins, spheres)
        openness = _openness(start, n, way, near[:n_near], scene, ambient[3], opening)
        for c in range(3):
            light[place, c] = ambient[c] * openness * (0.85 + 0.15 * n[2])
        _add_lamps(light[place], start, n, way, every[:n_every], scene, lamps)
        facing = n[0] * sun[0] + n[1] * sun[1] + n[2] * sun[2]
        if facing > 0.0 and not _is_blocked(start, sun[:3], _NEVER, every[:n_every], scene):
            for c in range(3):
                light[place, c] += facing * sun[3 + c]


@_kernel
def _add_lamps(
    light: npt.NDArray[Any],
    start: npt.NDArray[Any],
    n: npt.NDArray[Any],
    way: npt.NDArray[Any],
    candidates: npt.NDArray[Any],
    scene: tuple[Any, ...],
    lamps: npt.NDArray[Any],
) -> None:
    for k in range(lamps.shape[0]):
        square = 0.0
        for c in range(3):
            way[c] = lamps[k, c] - start[c]
            square += way[c] * way[c]
        away = math.sqrt(square)
        here, there = 0.0, 0.0
        for c in range(3):
            way[c] /= away
            here += way[c] * n[c]
            there -= way[c] * lamps[k, 3 + c]
        if here <= 0.0 or there <= 0.0:
            continue
        if not _is_blocked(start, way, away - 0.05, candidates, scene):
            for c in range(3):
                light[c] += lamps[k, 6 + c] * here * there / max(square, 0.1)


@_kernel
def _openness(
    start: npt.NDArray[Any],
    n: npt.NDArray[Any],
    way: npt.NDArray[Any],
    candidates: npt.NDArray[Any],
    scene: tuple[Any, ...],
    reach_m: float,
    opening: npt.NDArray[Any],
) -> Any:
    """Return the share of the ambient light that reaches a place."""
    if candidates.shape[0] == 0:
        return 1.0
    # Two axes beside the normal: the one that is least along it comes first.
    ax, ay, az = (0.0, 0.0, 1.0) if abs(n[2]) < 0.9 else (1.0, 0.0, 0.0)
    bx, by, bz = ay * n[2] - az * n[1], az * n[0] - ax * n[2], ax * n[1] - ay * n[0]
    length = math.sqrt(bx * bx + by * by + bz * bz)
    bx, by, bz = bx / length, by / length, bz / length
    cx, cy, cz = n[1] * bz - n[2] * by, n[2] * bx - n[0] * bz, n[0] * by - n[1] * bx
    total = 0.0
    for k in range(opening.shape[0]):
        o = opening[k]
        way[0] = o[0] * bx + o[1] * cx + o[2] * n[0]
        way[1] = o[0] * by + o[1] * cy + o[2] * n[1]
        way[2] = o[0] * bz + o[1] * cz + o[2] * n[2]
        t = reach_m
        for i in range(candidates.shape[0]):
            t = min(t, _range_to(start, way, candidates[i], scene))
        total += t / reach_m
    return 0.15 + 0.85 * total / opening.shape[0]


@_kernel
def _is_blocked(
    start: npt.NDArray[Any], way: npt.NDArray[Any], away: float, candidates: npt.NDArray[Any], scene: tuple[Any, ...]
) -> bool:
    for i in range(candidates.shape[0]):  # noqa: SIM110, numba knows no any()
        if _range_to(start, way, candidates[i], scene) < away:
            return True
    return False


@_kernel
def _range_to(start: npt.NDArray[Any], way: npt.NDArray[Any], p: int, scene: tuple[Any, ...]) -> Any:
    """Return the range to one shape, from either side."""
    kinds, frames, origins, spheres = scene
    along, square = 0.0, 0.0
    for c in range(3):
        d = spheres[p, c] - start[c]
        along += d * way[c]
        square += d * d
    radius = spheres[p, 3]
    if square - along * along > radius * radius or along < -radius:
        return _NEVER
    frame = frames[p]
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
