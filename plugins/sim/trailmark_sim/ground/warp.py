"""Kernels from tiles to a picture: one warp, then light, noise and grey steps."""

from __future__ import annotations

import sys
from functools import partial
from typing import NamedTuple

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.kernels import inner_kernel, kernel
from trailmark_sim.ground.regions import TileRegion
from trailmark_sim.ground.tiles import GREY_STEPS, TILE_TEXELS
from trailmark_sim.hashing import hash2
from trailmark_sim.interpolation import between

__all__ = ["GreyResponse", "expose_rows", "warp_rows"]

_SHIFT = TILE_TEXELS.bit_length() - 1
_SIDE = TILE_TEXELS + 1
_TILE = _SIDE * _SIDE
#: Where the first and the second texel of a pair stand among its bits.
_FIRST, _SECOND = (np.uint32(n) for n in ((0, 16) if sys.byteorder == "little" else (16, 0)))
_LOW16 = np.uint32(0xFFFF)
_ZERO, _HALF, _ONE, _WHITE = (np.float32(value) for value in (0.0, 0.5, 1.0, 255.0))
# A 32-bit hash (Chris Wellons, "lowbias32"), and mean and deviation of the sum of its four bytes.
_M1, _M2 = np.uint32(0x7FEB352D), np.uint32(0x846CA68B)
_S8, _S15, _S16, _S24, _S31 = (np.uint32(n) for n in (8, 15, 16, 24, 31))
_BYTE = np.uint32(0xFF)
_MEAN, _PER_SIGMA = np.float32(510.0), np.float32(1.0 / (4.0 * 65535.0 / 12.0) ** 0.5)

# A division that may fail would keep the loops from being done eight at once.
_kernel, _inner_kernel = kernel(error_model="numpy"), partial(inner_kernel, error_model="numpy")


class GreyResponse(NamedTuple):
    """How a ground camera turns light into grey levels, with which noise.

    Attributes
    ----------
    gain, offset : float
        Factor, and grey levels added to it.
    dark_var : float
        Variance of the noise of black [levels^2].
    grey_var : float
        Variance that every grey level adds [levels].
    """

    gain: float
    offset: float
    dark_var: float
    grey_var: float


@_kernel
def warp_rows(out: AnyArray, first: int, last: int, region: TileRegion) -> None:
    """Read rows `first` to `last` of a picture (H, W) float32 off the tiles, bilinear."""
    scratch = _scratch(out.shape[1])
    for row in range(first, last):
        _warp_row(out[row], row, region, scratch)


@_kernel
def expose_rows(
    out: AnyArray, first: int, last: int, region: TileRegion, light: AnyArray, response: GreyResponse, seed: np.uint64
) -> None:
    """Take rows of a picture: warp, then light, noise, grey steps and clipping.

    Parameters
    ----------
    out : (H, W) uint8
        Receives rows `first` to `last`.
    region : TileRegion
        What the picture shows.
    light : (H, W) float32
        Brightness of the light and the lens, 1 on average.
    response : GreyResponse
        Of the camera.
    seed : uint64
        Of this picture's noise.
    """
    scratch = _scratch(out.shape[1])
    line = np.empty(out.shape[1], np.float32)
    for row in range(first, last):
        _warp_row(line, row, region, scratch)
        _develop_row(out[row], line, light[row], response, np.uint32(hash2(row, 0, seed)))


# The loops of a row are kept apart and simple, so that each does eight or sixteen pixels at once: 0.6 ms a
# picture of 512 x 480 in place of 1.8 ms in one loop.


class _RowScratch(NamedTuple):
    """Of each pixel of a row: column and row of its texel and its place in memory, fractions, pairs of texels."""

    texels: AnyArray
    parts: AnyArray
    pairs: AnyArray


@_inner_kernel
def _scratch(width: int) -> _RowScratch:
    return _RowScratch(
        np.empty((3, width), np.int32), np.empty((2, width), np.float32), np.empty((2, width), np.uint32)
    )


@_inner_kernel
def _warp_row(line: AnyArray, row: int, region: TileRegion, scratch: _RowScratch) -> None:
    index, part, pair = scratch
    texel_pixel = region.texel_pixel[row % region.texel_pixel.shape[0]]
    line[:] = _ZERO
    for s in range(texel_pixel.shape[0]):
        _locate(index[0], index[1], part[0], part[1], texel_pixel[s], row)
        _address(index[2], index[0], index[1], region.slots)
        _fetch(pair[0], pair[1], index[2], region.pairs)
        _blend(line, pair[0], pair[1], part[0], part[1], np.float32(1.0 / (GREY_STEPS * texel_pixel.shape[0])))


@_inner_kernel
def _locate(i: AnyArray, j: AnyArray, fx: AnyArray, fy: AnyArray, m: AnyArray, row: int) -> None:
    """Find the texel and the fractions for every pixel of a row."""
    a, b, c = np.float32(m[0, 0]), np.float32(m[1, 0]), np.float32(m[2, 0])
    x0, y0 = np.float32(m[0, 1] * row + m[0, 2]), np.float32(m[1, 1] * row + m[1, 2])
    w0 = np.float32(m[2, 1] * row + m[2, 2])
    for col in range(i.shape[0]):
        u = np.float32(np.int32(col))  # of 32 bits, as the rest: twice as many at once
        w = _ONE / (w0 + c * u)
        x, y = (x0 + a * u) * w, (y0 + b * u) * w
        i[col], j[col] = np.int32(x), np.int32(y)
        fx[col], fy[col] = x - np.float32(i[col]), y - np.float32(j[col])


@_inner_kernel
def _address(at: AnyArray, i: AnyArray, j: AnyArray, slots: AnyArray) -> None:
    """Turn texels of the region into places in memory, one run of pixels on the same tile after the other."""
    first = 0
    while first < i.shape[0]:
        last = _end_of_tile(i, j, first)
        col, row = i[first] >> _SHIFT, j[first] >> _SHIFT
        base = np.int32(slots[row, col] * _TILE - (row * _SIDE + col) * TILE_TEXELS)
        _add_base(at[first:last], i[first:last], j[first:last], base)
        first = last


@_inner_kernel
def _end_of_tile(i: AnyArray, j: AnyArray, first: int) -> int:
    """Return the first pixel beyond the tile that `first` lies on; along a row a tile is left only once."""
    low, high = first, i.shape[0]
    while low + 1 < high:
        middle = (low + high) >> 1
        if ((i[first] ^ i[middle]) | (j[first] ^ j[middle])) >> _SHIFT == 0:
            low = middle
        else:
            high = middle
    return int(high)


@_inner_kernel
def _add_base(at: AnyArray, i: AnyArray, j: AnyArray, base: np.int32) -> None:
    for col in range(at.shape[0]):
        at[col] = base + j[col] * np.int32(_SIDE) + i[col]


@_inner_kernel
def _fetch(above: AnyArray, below: AnyArray, at: AnyArray, pairs: AnyArray) -> None:
    for col in range(at.shape[0]):
        k = np.uint64(at[col])  # unsigned: no test for indices from the end
        above[col] = pairs[k]
        below[col] = pairs[k + np.uint64(_SIDE)]


@_inner_kernel
def _blend(
    line: AnyArray,
    above: AnyArray,
    below: AnyArray,
    fx: AnyArray,
    fy: AnyArray,
    scale: np.float32,
) -> None:
    for col in range(line.shape[0]):
        a, b = _texel(above[col] >> _FIRST), _texel(above[col] >> _SECOND)
        c, d = _texel(below[col] >> _FIRST), _texel(below[col] >> _SECOND)
        line[col] += between(a, b, c, d, fx[col], fy[col]) * scale


@_inner_kernel
def _texel(bits: np.uint32) -> np.float32:
    return np.float32(np.int32(bits & _LOW16))


@_inner_kernel
def _develop_row(out: AnyArray, line: AnyArray, light: AnyArray, response: GreyResponse, start: np.uint32) -> None:
    gain, offset = np.float32(response.gain), np.float32(response.offset)
    dark_var, grey_var = np.float32(response.dark_var), np.float32(response.grey_var)
    for col in range(out.shape[0]):
        value = line[col] * light[col] * gain + offset
        sigma = np.sqrt(max(dark_var + grey_var * value, _ZERO))
        value += sigma * _normal32(start, np.uint32(col))
        out[col] = np.uint8(np.int32(min(max(value, _ZERO), _WHITE) + _HALF))


@_kernel
def _normal32(start: np.uint32, n: np.uint32) -> np.float32:
    """Return a nearly normal number (four uniform bytes) of place `n` after `start`, in 32-bit arithmetic throughout.

    numba takes every result for one of 64 bits, whose products run an eighth as fast, until it is told otherwise.
    """
    counter = np.uint32(start + n)
    ran_over = np.uint32(np.uint32(start & n) | np.uint32(np.uint32(start | n) & ~counter))
    carry = np.uint32(np.uint32(ran_over >> _S31) << _S16)  # as if the counter had a bit more
    h = np.uint32(np.uint32(counter ^ np.uint32(np.uint32(counter >> _S16) | carry)) * _M1)
    h = np.uint32(np.uint32(h ^ np.uint32(h >> _S15)) * _M2)
    h = np.uint32(h ^ np.uint32(h >> _S16))
    total = np.uint32(h & _BYTE) + np.uint32((h >> _S8) & _BYTE) + np.uint32((h >> _S16) & _BYTE) + np.uint32(h >> _S24)
    return np.float32((np.float32(np.int32(total)) - _MEAN) * _PER_SIGMA)
