"""Kernels from tiles to a picture: one warp, then light, noise and grey steps."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.kernels import kernel
from trailmark_sim.ground.tiles import GREY_STEPS, TILE_TEXELS
from trailmark_sim.hashing import hash2
from trailmark_sim.interpolation import between

__all__ = ["expose_rows", "touched_tiles", "warp_rows"]

_SHIFT = TILE_TEXELS.bit_length() - 1
_SIDE = TILE_TEXELS + 1
_TILE = _SIDE * _SIDE
#: Where the first and the second texel of a pair stand among its bits.
_FIRST, _SECOND = (np.uint32(n) for n in ((0, 16) if sys.byteorder == "little" else (16, 0)))
_LOW16 = np.uint32(0xFFFF)
_ZERO, _HALF, _ONE, _WHITE = (np.float32(value) for value in (0.0, 0.5, 1.0, 255.0))
# A 32-bit hash (Chris Wellons, "lowbias32"), and mean and deviation of the sum of its four bytes.
_M1, _M2 = np.uint32(0x7FEB352D), np.uint32(0x846CA68B)
_S8, _S15, _S16, _S24 = (np.uint32(n) for n in (8, 15, 16, 24))
_BYTE = np.uint32(0xFF)
_MEAN, _PER_SIGMA = np.float32(510.0), np.float32(1.0 / (4.0 * 65535.0 / 12.0) ** 0.5)

# A division that may fail would keep the loops from being done eight at once.
_kernel = kernel(error_model="numpy")


@_kernel
def touched_tiles(
    pixel_texel: npt.NDArray[Any], region: tuple[int, int, int, int], size: tuple[int, int], margin_px: float
) -> npt.NDArray[Any]:
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


@_kernel
def warp_rows(
    out: npt.NDArray[Any],
    first: int,
    last: int,
    texel_pixel: npt.NDArray[Any],
    pairs: npt.NDArray[Any],
    slots: npt.NDArray[Any],
) -> None:
    """Read rows of a picture off the tiles, bilinear; several homographies are averaged.

    Parameters
    ----------
    out : (H, W) float32
        Receives the greys of rows `first` to `last`.
    texel_pixel : (R, S, 3, 3) float64
        From pixels to texels of the region of tiles, one for each instant of the exposure; for every row (R = H), or
        the same for all (R = 1).
    pairs : (N,) uint32
        All texels, each together with its right neighbour, in steps of 1/256 grey; see `TileStore.pairs`.
    slots : (rows, cols) int32
        Number of each tile of the region.
    """
    width = out.shape[1]
    index, part, pair = (
        np.empty((3, width), np.int32),
        np.empty((2, width), np.float32),
        np.empty((2, width), np.uint32),
    )
    for row in range(first, last):
        _warp_row(out[row], row, texel_pixel[row % texel_pixel.shape[0]], pairs, slots, index, part, pair)


@_kernel
def expose_rows(
    out: npt.NDArray[Any],
    first: int,
    last: int,
    texel_pixel: npt.NDArray[Any],
    pairs: npt.NDArray[Any],
    slots: npt.NDArray[Any],
    light: npt.NDArray[Any],
    camera: tuple[float, float, float, float],
    seed: np.uint64,
) -> None:
    """Take rows of a picture: warp, then light, noise, grey steps and clipping.

    Parameters
    ----------
    out : (H, W) uint8
        Receives rows `first` to `last`.
    texel_pixel, pairs, slots
        As in `warp_rows`.
    light : (H, W) float32
        Brightness of the light and the lens, 1 on average.
    camera : (gain, offset, dark_var, grey_var)
        Gain and offset; variance of the noise of a black pixel, and what every grey level adds to it.
    seed : uint64
        Of this picture's noise.
    """
    width = out.shape[1]
    index, part, pair = (
        np.empty((3, width), np.int32),
        np.empty((2, width), np.float32),
        np.empty((2, width), np.uint32),
    )
    line = np.empty(width, np.float32)
    for row in range(first, last):
        _warp_row(line, row, texel_pixel[row % texel_pixel.shape[0]], pairs, slots, index, part, pair)
        _develop_row(out[row], line, light[row], camera, np.uint32(hash2(row, 0, seed)))


# The loops of a row are kept apart and simple, so that each does eight or sixteen pixels at once: 0.6 ms a
# picture of 512 x 480 in place of 1.8 ms in one loop.


@_kernel
def _warp_row(
    line: npt.NDArray[Any],
    row: int,
    texel_pixel: npt.NDArray[Any],
    pairs: npt.NDArray[Any],
    slots: npt.NDArray[Any],
    index: npt.NDArray[Any],
    part: npt.NDArray[Any],
    pair: npt.NDArray[Any],
) -> None:
    line[:] = _ZERO
    for s in range(texel_pixel.shape[0]):
        _locate(index[0], index[1], part[0], part[1], texel_pixel[s], row)
        _address(index[2], index[0], index[1], slots)
        _fetch(pair[0], pair[1], index[2], pairs)
        _blend(line, pair[0], pair[1], part[0], part[1], np.float32(1.0 / (GREY_STEPS * texel_pixel.shape[0])))


@_kernel
def _locate(
    i: npt.NDArray[Any], j: npt.NDArray[Any], fx: npt.NDArray[Any], fy: npt.NDArray[Any], m: npt.NDArray[Any], row: int
) -> None:
    """Find the texel and the fractions for every pixel of a row."""
    a, b, c = np.float32(m[0, 0]), np.float32(m[1, 0]), np.float32(m[2, 0])
    x0, y0 = np.float32(m[0, 1] * row + m[0, 2]), np.float32(m[1, 1] * row + m[1, 2])
    w0 = np.float32(m[2, 1] * row + m[2, 2])
    for col in range(i.shape[0]):
        w = _ONE / (w0 + c * np.float32(col))
        x, y = (x0 + a * np.float32(col)) * w, (y0 + b * np.float32(col)) * w
        i[col], j[col] = np.int32(x), np.int32(y)
        fx[col], fy[col] = x - np.float32(i[col]), y - np.float32(j[col])


@_kernel
def _address(at: npt.NDArray[Any], i: npt.NDArray[Any], j: npt.NDArray[Any], slots: npt.NDArray[Any]) -> None:
    """Turn texels of the region into places in memory, one run of pixels on the same tile after the other."""
    first = 0
    while first < i.shape[0]:
        last = _end_of_tile(i, j, first)
        col, row = i[first] >> _SHIFT, j[first] >> _SHIFT
        base = np.int32(slots[row, col] * _TILE - (row * _SIDE + col) * TILE_TEXELS)
        _add_base(at[first:last], i[first:last], j[first:last], base)
        first = last


@_kernel
def _end_of_tile(i: npt.NDArray[Any], j: npt.NDArray[Any], first: int) -> int:
    """Return the first pixel beyond the tile that `first` lies on; along a row a tile is left only once."""
    low, high = first, i.shape[0]
    while low + 1 < high:
        middle = (low + high) >> 1
        if ((i[first] ^ i[middle]) | (j[first] ^ j[middle])) >> _SHIFT == 0:
            low = middle
        else:
            high = middle
    return int(high)


@_kernel
def _add_base(at: npt.NDArray[Any], i: npt.NDArray[Any], j: npt.NDArray[Any], base: np.int32) -> None:
    for col in range(at.shape[0]):
        at[col] = base + j[col] * np.int32(_SIDE) + i[col]


@_kernel
def _fetch(above: npt.NDArray[Any], below: npt.NDArray[Any], at: npt.NDArray[Any], pairs: npt.NDArray[Any]) -> None:
    for col in range(at.shape[0]):
        k = np.uint64(at[col])  # unsigned: no test for indices from the end
        above[col] = pairs[k]
        below[col] = pairs[k + np.uint64(_SIDE)]


@_kernel
def _blend(
    line: npt.NDArray[Any],
    above: npt.NDArray[Any],
    below: npt.NDArray[Any],
    fx: npt.NDArray[Any],
    fy: npt.NDArray[Any],
    scale: np.float32,
) -> None:
    for col in range(line.shape[0]):
        a, b = _texel(above[col] >> _FIRST), _texel(above[col] >> _SECOND)
        c, d = _texel(below[col] >> _FIRST), _texel(below[col] >> _SECOND)
        line[col] += between(a, b, c, d, fx[col], fy[col]) * scale


@_kernel
def _texel(bits: np.uint32) -> np.float32:
    return np.float32(np.int32(bits & _LOW16))


@_kernel
def _develop_row(
    out: npt.NDArray[Any],
    line: npt.NDArray[Any],
    light: npt.NDArray[Any],
    camera: tuple[float, float, float, float],
    start: np.uint32,
) -> None:
    gain, offset = np.float32(camera[0]), np.float32(camera[1])
    dark_var, grey_var = np.float32(camera[2]), np.float32(camera[3])
    for col in range(out.shape[0]):
        value = line[col] * light[col] * gain + offset
        sigma = np.sqrt(max(dark_var + grey_var * value, _ZERO))
        value += sigma * _normal32(start + np.uint32(col))
        out[col] = np.uint8(np.int32(min(max(value, _ZERO), _WHITE) + _HALF))


@_kernel
def _normal32(h: np.uint32) -> np.float32:
    """Return a nearly normal number (four uniform bytes) of a 32-bit counter, in 32-bit arithmetic throughout."""
    h = np.uint32(np.uint32(h ^ np.uint32(h >> _S16)) * _M1)
    h = np.uint32(np.uint32(h ^ np.uint32(h >> _S15)) * _M2)
    h = np.uint32(h ^ np.uint32(h >> _S16))
    total = (h & _BYTE) + ((h >> _S8) & _BYTE) + ((h >> _S16) & _BYTE) + (h >> _S24)
    return np.float32((np.float32(np.int32(total)) - _MEAN) * _PER_SIGMA)
