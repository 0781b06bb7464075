"""Light on surfaces, computed once: direct light with shadows, and how much of the surroundings each place sees."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Float32s, Floats, Int32s
from trailmark_sim.render.light_kernels import Blockers, LightPlaces, LightSources, light_places
from trailmark_sim.render.shapes import CYLINDER, RECTANGLE, Shape
from trailmark_sim.workers import in_bands

__all__ = ["Lamp", "Lighting", "bake_light"]

Colour = tuple[float, float, float]

_N_OPEN = 48
_ROUND_PATCH = (12, 6)
_MOST_TEXELS = 256


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

    def samples(self) -> list[Floats]:
        """Return the places of 2 x 2 points that stand for it [m]."""
        middle, a, b = (np.asarray(v) for v in (self.centre, self.along, self.across))
        return [middle + i * a + j * b for i in (-0.25, 0.25) for j in (-0.25, 0.25)]


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

    def sources(self) -> LightSources:
        """Return it as the kernels take it."""
        samples = [(point, lamp) for lamp in self.lamps for point in lamp.samples()]
        lamps, facings, powers = np.empty((3, len(samples), 3))
        for k, (point, lamp) in enumerate(samples):
            lamps[k], facings[k], powers[k] = point, lamp.facing, np.array(lamp.power) / 4.0
        sun = np.array(self.sun if self.sun is not None else (0.0, 0.0, 0.0), np.float64)
        sun /= max(1e-12, float(np.linalg.norm(sun)))
        sky = (np.array(self.sunlight, np.float64), np.array(self.ambient, np.float64), float(self.reach_m))
        return LightSources(lamps, facings, powers, sun, *sky, _OPEN)

    def key(self) -> Floats:
        """Return the direction to the brightest light."""
        direction = np.array(self.sun or (0.2, 0.1, 1.0))
        return np.asarray(direction / np.linalg.norm(direction))


def bake_light(
    shapes: Sequence[Shape], blocks: Sequence[bool], lighting: Lighting, threads: int = 1
) -> tuple[Float32s, Int32s]:
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
    positions, normals = (np.concatenate(parts) for parts in zip(*pieces))
    owners = np.repeat(np.arange(len(shapes)), patches[:, 1] * patches[:, 2])
    places = LightPlaces(positions, normals, owners)
    light = np.empty((at, 3), np.float32)
    blockers, sources = _blockers(shapes, blocks), lighting.sources()
    in_bands(lambda first, last: light_places(first, last, places, blockers, sources, light), at, threads)
    return light, patches


def _grid(shape: Shape, texel_m: float) -> tuple[int, int]:
    if shape.kind != RECTANGLE:
        return _ROUND_PATCH
    columns, rows = (min(_MOST_TEXELS, max(2, math.ceil(size / texel_m))) for size in shape.size_m)
    return columns, rows


def _places(shape: Shape, columns: int, rows: int) -> tuple[Floats, Floats]:
    """Return the places of a shape and the normals there, (rows * columns, 3) each."""
    v, u = np.meshgrid((np.arange(rows) + 0.5) / rows, (np.arange(columns) + 0.5) / columns, indexing="ij")
    inverse = np.linalg.inv(shape.frame)
    if shape.kind == RECTANGLE:
        local = np.stack([np.zeros_like(u), u, v], axis=-1).reshape(-1, 3)
        return shape.origin + local @ inverse.T, np.broadcast_to(shape.frame[0], local.shape)
    angle = (u - 0.5) * 2.0 * math.pi
    height = v if shape.kind == CYLINDER else 2.0 * v - 1.0
    around = np.ones_like(u) if shape.kind == CYLINDER else np.sqrt(1.0 - height**2)
    local = np.stack([height, around * np.cos(angle), around * np.sin(angle)], axis=-1).reshape(-1, 3)
    outward = local * (0.0, 1.0, 1.0) if shape.kind == CYLINDER else local
    normals = outward @ shape.frame
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return shape.origin + local @ inverse.T, normals


def _blockers(shapes: Sequence[Shape], blocks: Sequence[bool]) -> Blockers:
    spheres = np.array([(*shape.centre, shape.radius_m) for shape in shapes])
    kinds = np.array([shape.kind for shape in shapes], np.int8)
    solid = np.zeros(len(shapes), np.bool_)
    solid[: len(blocks)] = blocks
    frames, origins = np.stack([shape.frame for shape in shapes]), np.stack([shape.origin for shape in shapes])
    return Blockers(kinds, frames, origins, spheres, solid, len(blocks))


def _open_directions() -> Floats:
    """Return directions about +z, spread like the light that a matt surface takes. The same everywhere: no blotches."""
    n = np.arange(_N_OPEN) + 0.5
    sine, turn = np.sqrt(n / _N_OPEN), n * math.pi * (3.0 - math.sqrt(5.0))
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), np.sqrt(1.0 - sine**2)], axis=1)


_OPEN = _open_directions()
