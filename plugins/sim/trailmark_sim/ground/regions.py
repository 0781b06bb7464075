"""The region of tiles that a picture shows, and which of them it touches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.kernels import kernel
from trailmark_sim.ground.tiles import TILE_TEXELS

__all__ = ["TileRegion", "touched_tiles"]


class TileRegion(NamedTuple):
    """A region of tiles that a picture shows.

    Attributes
    ----------
    texel_pixel : (R, S, 3, 3) float64
        From pixels to texels of the region, one homography for each instant of the exposure, which are averaged; for
        every row (R = H), or the same for all (R = 1).
    pairs : (N,) uint32
        All texels, each together with its right neighbour, in steps of 1/256 grey; see `TileStore.pairs`.
    slots : (rows, cols) int32
        Number of each tile of the region.
    """

    texel_pixel: AnyArray
    pairs: AnyArray
    slots: AnyArray


@kernel(error_model="numpy")
def touched_tiles(
    pixel_texel: AnyArray, region: tuple[int, int, int, int], size: tuple[int, int], margin_px: float
) -> AnyArray:
    """Return which tiles of a region a picture touches.

    Parameters
    ----------
    pixel_texel : (3, 3) float64
        Homography from texels of the map to pixels.
    region : (int, int, int, int)
        First column and row of tiles, and how many columns and rows.
    size : (int, int)
        Width and height of the picture [px].
    margin_px : float
        Tiles that come this close to the picture count as touched [px].

    Returns
    -------
    (rows, cols) bool
        False where all corners of the tile lie beyond the same side of the picture.
    """
    tile_x, tile_y, n_cols, n_rows = region
    touched = np.empty((n_rows, n_cols), dtype=np.bool_)
    m = pixel_texel
    for row in range(n_rows):
        for col in range(n_cols):
            u_min = v_min = 1e18
            u_max = v_max = -1e18
            for n in range(4):
                x, y = (tile_x + col + n % 2) * TILE_TEXELS, (tile_y + row + n // 2) * TILE_TEXELS
                w = m[2, 0] * x + m[2, 1] * y + m[2, 2]
                u, v = (m[0, 0] * x + m[0, 1] * y + m[0, 2]) / w, (m[1, 0] * x + m[1, 1] * y + m[1, 2]) / w
                u_min, u_max, v_min, v_max = min(u_min, u), max(u_max, u), min(v_min, v), max(v_max, v)
            across = u_max >= -margin_px and u_min <= size[0] - 1 + margin_px
            touched[row, col] = across and v_max >= -margin_px and v_min <= size[1] - 1 + margin_px
    return touched
