"""The search for the motion between two pictures: Eqs. (1) and (2) of Nagai & Watanabe (2015).

A group of reference pixels is shifted and turned like a rigid body over the new picture; E(i, j, k) is the sum of
absolute differences for every shift (i, j) around the predicted one and every turn k. Sums are exact, so that the
vector kernel and the plain one give the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from trailmark.arrays import Floats, Grey8, Int32s, Int64s
from trailmark.kernels import inner_kernel, kernel
from trailmark_ground_vo.vector import CHUNK, add_window, padded_columns, padded_rows

__all__ = ["centre_out", "places", "reach", "rotation_angles", "sad_search", "sad_search_plain", "summarise"]

SadSearch = Callable[[Grey8, Grey8, Int64s, Grey8], Int32s]

#: Rows of the picture that share the first-level cache well: pixels are visited in bands of this height.
_BAND_PX = 16


def rotation_angles(steps: int, step_rad: float) -> Floats:
    """Return the angles of the search, (2 steps + 1,) from -steps to +steps [rad]."""
    return np.asarray(np.arange(-steps, steps + 1) * step_rad, np.float64)


@kernel
def places(
    x: Floats,
    y: Floats,
    centre: tuple[float, float],
    shift: tuple[float, float],
    angles: Floats,
    aspect: float,
    limits: tuple[int, int, int, int],
) -> Int64s:
    """Return where the pixels of a group fall for every turn: the bracket of Eq. (1), without i and j.

    Parameters
    ----------
    x, y : (N,) float64
        Coordinates T of the group [px].
    centre : (float, float)
        Centre of rotation O [px].
    shift : (float, float)
        Predicted translation p [px].
    angles : (K,) float64
        Angles k [rad].
    aspect : float
        Metres per pixel along v over those along u: on the ground, turns are rigid.
    limits : (int, int, int, int)
        First and last u, first and last v that the search may read around; places beyond are moved there.

    Returns
    -------
    (2, K, N) int64
        Pixels u and v: the integer part of the coordinate of a pixel's corner, that is the nearest pixel.
    """
    out = np.empty((2, len(angles), len(x)), np.int64)
    for k in range(len(angles)):
        cos, sin = math.cos(angles[k]), math.sin(angles[k])
        across, down = sin * aspect, sin / aspect
        to_x, to_y = centre[0] + shift[0] + 0.5, centre[1] + shift[1] + 0.5
        for n in range(len(x)):
            dx, dy = x[n] - centre[0], y[n] - centre[1]
            u: int = math.floor(cos * dx + across * dy + to_x)
            v: int = math.floor(cos * dy - down * dx + to_y)
            out[0, k, n] = min(max(u, limits[0]), limits[1])
            out[1, k, n] = min(max(v, limits[2]), limits[3])
    return out


@inner_kernel
def _in_bands(v: Int64s) -> Int64s:
    """Return the order of the pixels by bands of rows (a counting sort)."""
    last = 0
    for n in range(len(v)):
        last = max(last, v[n])
    n_bands = last // _BAND_PX + 2
    starts = np.zeros(n_bands, np.int64)
    for n in range(len(v)):
        starts[v[n] // _BAND_PX + 1] += 1
    for band in range(1, n_bands):
        starts[band] += starts[band - 1]
    order = np.empty(len(v), np.int64)
    for n in range(len(v)):
        band = v[n] // _BAND_PX
        order[starts[band]] = n
        starts[band] += 1
    return order


@lru_cache
def sad_search(search_px: int) -> SadSearch:
    """Return the vector kernel that computes E of Eq. (1) for shifts of +-`search_px` pixels.

    Returns
    -------
    callable
        ``(image, image_t, spots, values) -> errors``: (H, W) and (W, H) uint8, the (2, K, N) int64 of `places`
        and the (N,) uint8 intensities I give the (K, J, I) int32 sums of absolute differences, j and i from
        -`search_px` on. The picture is read up to `reach` pixels around each place.
    """
    size = 2 * search_px + 1
    columns, rows = padded_columns(size), max(1, padded_rows(size))

    @kernel
    def search(image: Grey8, image_t: Grey8, spots: Int64s, values: Grey8) -> Int32s:
        height, width = image.shape
        _, n_angles, n_pixels = spots.shape
        errors = np.empty((n_angles, size, size), np.int32)
        window, leftover = np.empty((size, columns), np.int32), np.empty(rows, np.int32)
        offsets, offsets_t = np.empty(n_pixels, np.int64), np.empty(n_pixels, np.int64)
        order = _in_bands(spots[1, n_angles // 2])
        minus = np.empty(n_pixels, np.int16)
        for n in range(n_pixels):
            minus[n] = -np.int16(values[order[n]])
        for k in range(n_angles):
            for n in range(n_pixels):
                u, v = spots[0, k, order[n]], spots[1, k, order[n]]
                offsets[n] = (v - search_px) * width + u - search_px
                offsets_t[n] = (u + search_px) * height + v - search_px
            window.fill(0)
            leftover.fill(0)
            for start in range(0, n_pixels, CHUNK):
                stop = min(start + CHUNK, n_pixels)
                add_window(size, image, offsets, image_t, offsets_t, minus, start, stop, window, leftover)
            for j in range(size):
                for i in range(min(size, columns)):
                    errors[k, j, i] = window[j, i]
                if columns < size:
                    errors[k, j, size - 1] = leftover[j]
        return errors

    return search


@lru_cache
def sad_search_plain(search_px: int) -> SadSearch:
    """Return a kernel that does what `sad_search` does, without vectors."""
    size = 2 * search_px + 1

    @kernel
    def search(image: Grey8, image_t: Grey8, spots: Int64s, values: Grey8) -> Int32s:
        _, n_angles, n_pixels = spots.shape
        errors = np.zeros((n_angles, size, size), np.int32)
        for k in range(n_angles):
            for n in range(n_pixels):
                value = np.int32(values[n])
                left, top = spots[0, k, n] - search_px, spots[1, k, n] - search_px
                for j in range(size):
                    row = image[top + j, left : left + size]
                    for i in range(size):  # int32: in 8 or 16 bits numba would leave the vector registers
                        errors[k, j, i] += abs(np.int32(row[i]) - value)
        return errors

    return search


def reach(search_px: int) -> int:
    """Return how far around a place the search may read, to the right and down [px]."""
    size = 2 * search_px + 1
    return max(padded_columns(size), padded_rows(size)) - search_px


@lru_cache
def centre_out(n_angles: int, size: int) -> Int32s:
    """Return the rank of every candidate, (K, J, I) int32: small turns first, then small shifts.

    The paper does not say which of equal minima wins; a robot that stands still must not be told to move.
    """
    k, j, i = np.meshgrid(*(np.arange(n) - n // 2 for n in (n_angles, size, size)), indexing="ij")
    order = np.lexsort([part.ravel() for part in (i, j, i * i + j * j, k, np.abs(k))])
    ranks = np.empty(order.size, np.int32)
    ranks[order] = np.arange(order.size, dtype=np.int32)
    return ranks.reshape(k.shape)


@kernel
def summarise(errors: Int32s, ranks: Int32s) -> tuple[int, int, int, int, float]:
    """Return the indices (k, j, i) of the minimum of E, Eq. (2), the minimum and the mean of E.

    Of equal minima the one of lowest rank wins.
    """
    flat, flat_ranks = errors.reshape(-1), ranks.reshape(-1)
    least, total = flat[0], np.int64(0)
    for index in range(flat.size):
        least = min(least, flat[index])
        total += flat[index]
    best = -1
    for index in range(flat.size):
        if flat[index] == least and (best < 0 or flat_ranks[index] < flat_ranks[best]):
            best = index
    _, size_j, size_i = errors.shape
    return best // (size_j * size_i), best // size_i % size_j, best % size_i, least, total / flat.size
