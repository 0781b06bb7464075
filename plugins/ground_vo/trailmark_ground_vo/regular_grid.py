"""A regular grid of pixels, wherever the picture is steep or plain: they had no part in finding a motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trailmark.arrays import Float32s, Int64s

__all__ = ["N_SIDE", "RegularGrid", "regular_grid"]

#: Parts of the picture along each side.
N_SIDE = 4

#: Distance of the pixels, and their distance from the rim [px].
_STEP_PX, _RIM_PX = 10, 4


class RegularGrid(NamedTuple):
    """Pixels at equal distances, the part of the picture that each lies in, and the centre that it turns about.

    Attributes
    ----------
    places : (2, n) float32
        Columns and rows of the pixels [px].
    parts : (n,) int64
        Number of the part, row by row, from 0 to ``N_SIDE**2 - 1``.
    centre : (float, float)
        Of the picture [px].
    """

    places: Float32s
    parts: Int64s
    centre: tuple[float, float]


def regular_grid(size: tuple[int, int]) -> RegularGrid:
    """Return the grid of pictures of a width and a height [px]."""
    u, v = np.meshgrid(*(np.arange(_RIM_PX, side - _RIM_PX, _STEP_PX) for side in size))
    columns, rows = (grid.ravel() * N_SIDE // side for grid, side in zip((u, v), size))
    return RegularGrid(
        np.array([u.ravel(), v.ravel()], np.float32),
        np.asarray(rows * N_SIDE + columns, np.int64),
        ((size[0] - 1) / 2.0, (size[1] - 1) / 2.0),
    )
