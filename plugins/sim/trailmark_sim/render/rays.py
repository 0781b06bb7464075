"""A camera as the kernels see it: unit rays in tiles of 64, each tile with a cone around it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trailmark.arrays import Bools, Float32s, Floats, Int32s, Int64s
from trailmark.errors import ShapeError

__all__ = ["LANES", "RayTable", "ray_table"]

#: Rays of a tile: as many as the kernels do in one go.
LANES = 64
_SIDE = 8


class RayTable(NamedTuple):
    """Unit rays of a central camera (or a laser), in the sensor's axes; kernels take it whole.

    Rays of a tile are cast together, from one place: of a camera that reads row after row a tile is 64 rays of a row.

    Attributes
    ----------
    shape : (int, int)
        Rows and columns of the picture.
    rays : (T, 3, 64) float32
        Directions; lanes of a tile that show nothing repeat another.
    pixels : (T, 64) int32
        Where in the flat picture each goes; -1: nowhere.
    axes : (T, 3) float32
        Middle of the cone around each tile.
    spread : (T, 2) float32
        Cosine and sine of half its opening.
    pixel_rad : (T, 64) float32
        Angle between each ray and its neighbours, the mean over a square of 8 x 8 [rad].
    instants : (T,) int32
        Number of the instant at which each tile is seen: its row, or 0 for all.
    """

    shape: tuple[int, int]
    rays: Float32s
    pixels: Int32s
    axes: Float32s
    spread: Float32s
    pixel_rad: Float32s
    instants: Int32s

    @property
    def n_tiles(self) -> int:
        """Number of tiles."""
        return len(self.rays)

    @property
    def n_rays(self) -> int:
        """Number of rays that show something."""
        return int((self.pixels >= 0).sum())

    def picture(self, values: Float32s, nothing: float) -> Float32s:
        """Return values (T, 64) of the rays as a picture (H, W)."""
        out = np.full(self.shape[0] * self.shape[1], nothing, dtype=np.float32)
        shows = self.pixels >= 0
        if shows.all():
            out[self.pixels] = values
        else:
            out[self.pixels[shows]] = values[shows]
        return out.reshape(self.shape)


def ray_table(directions: Floats, mask: Bools | None = None, by_row: bool = False) -> RayTable:
    """Return the table of a picture's rays.

    Parameters
    ----------
    directions : (H, W, 3) float64
        Unit vectors; a row of rays alone (H = 1) is cut into pieces of 64.
    mask : (H, W) bool or None
        Which pixels show anything.
    by_row : bool
        Every row at an instant of its own.

    Raises
    ------
    ShapeError
        If the shapes do not fit or no pixel shows anything.
    """
    if directions.ndim != 3 or directions.shape[2] != 3:
        raise ShapeError(f"directions must be (H, W, 3), not {directions.shape}")
    shape = directions.shape[:2]
    shown = np.ones(shape, dtype=np.bool_) if mask is None else mask
    if shown.shape != shape or not shown.any():
        raise ShapeError(f"the mask must be {shape} and show something")
    pixels = _tiles(shown, (1, LANES) if by_row or shape[0] == 1 else (_SIDE, _SIDE))
    rays = directions.reshape(-1, 3)[_fill_invalid(pixels)]
    axes, cosines = _cones(rays)
    sines = np.sqrt(1.0 - cosines**2)
    return RayTable(
        (shape[0], shape[1]),
        np.ascontiguousarray(rays.transpose(0, 2, 1), dtype=np.float32),
        pixels,
        axes.astype(np.float32),
        np.stack([cosines, sines], axis=1).astype(np.float32),
        _pixel_angles(directions, shown, pixels).astype(np.float32),
        pixels.max(axis=1) // np.int32(shape[1] if by_row else shown.size),
    )


def _tiles(shown: Bools, side: tuple[int, int]) -> Int32s:
    """Return the flat pixels of each tile that shows something, (T, 64), -1 for the others."""
    rows, cols = shown.shape
    side_v, side_u = side
    flat = np.where(shown, np.arange(rows * cols).reshape(rows, cols), -1)
    padded = np.pad(flat, ((0, -rows % side_v), (0, -cols % side_u)), constant_values=-1)
    n_v, n_u = padded.shape[0] // side_v, padded.shape[1] // side_u
    tiles = padded.reshape(n_v, side_v, n_u, side_u).transpose(0, 2, 1, 3).reshape(-1, LANES)
    return np.ascontiguousarray(tiles[(tiles >= 0).any(axis=1)], dtype=np.int32)


def _fill_invalid(pixels: Int32s) -> Int64s:
    """Return the pixels with a valid one in place of each -1."""
    first = pixels[np.arange(len(pixels)), (pixels >= 0).argmax(axis=1)]
    return np.where(pixels >= 0, pixels, first[:, None]).astype(np.int64)


def _cones(rays: Floats) -> tuple[Floats, Floats]:
    """Return axis and cosine of half the opening, a hair wider than the rays need."""
    axes = rays.mean(axis=1)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    cosines = np.einsum("tlc,tc->tl", rays, axes).min(axis=1)
    return axes, np.cos(np.arccos(np.clip(cosines, -1.0, 1.0)) + 1e-3)


def _pixel_angles(directions: Floats, shown: Bools, pixels: Int32s) -> Floats:
    """Return the typical angle between neighbouring rays about each pixel of the tiles, whatever their shape."""
    steps = [np.linalg.norm(np.diff(directions, axis=axis), axis=2) for axis in (0, 1) if directions.shape[axis] > 1]
    if not steps:
        return np.full(pixels.shape, math.radians(0.1))
    whole = [
        np.pad(step, [(0, n - m) for n, m in zip(directions.shape[:2], step.shape)], mode="edge") for step in steps
    ]
    angle = np.sqrt(np.mean([step**2 for step in whole], axis=0)).ravel()
    squares = _tiles(shown, (_SIDE, _SIDE))
    means = np.broadcast_to(angle[_fill_invalid(squares)].mean(axis=1)[:, None], squares.shape)
    around = np.zeros(len(angle))
    around[squares[squares >= 0]] = means[squares >= 0]
    return np.asarray(around[_fill_invalid(pixels)])
