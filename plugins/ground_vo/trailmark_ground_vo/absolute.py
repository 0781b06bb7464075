"""The search for a registered patch: Sec. II-B of Nagai & Watanabe (2015).

Eq. (1) again, for a patch of 44 x 44 pixels that is divided into four groups. The picture and the patch come in 7 bits,
which halves the work (see `vector.add_pairs`); with that the sums are exact, and both kernels give the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats, Int32s, Int64s
from trailmark.kernels import kernel
from trailmark_ground_vo.vector import LANES, PAIRS, add_pairs

__all__ = ["PatchSearch", "group_places", "patch_search", "patch_search_plain", "quadrants"]

Bits7 = npt.NDArray[np.int8]
PatchSearch = Callable[[Bits7, Bits7, Int64s, Bits7], Int32s]

_Number = TypeVar("_Number", bound=np.generic)

#: Vectors of sums that stay in registers together.
_REGISTERS = 24


def quadrants(patch: npt.NDArray[_Number]) -> npt.NDArray[_Number]:
    """Return the four quadrants of a square patch, (4, N), rows of the picture first."""
    half = len(patch) // 2
    blocks = (patch[:half, :half], patch[:half, half:], patch[half:, :half], patch[half:, half:])
    return np.stack([block.ravel() for block in blocks])


@kernel
def group_places(
    offsets_u: Floats,
    offsets_v: Floats,
    centre: tuple[float, float],
    angles: Floats,
    aspect: float,
    limits: tuple[int, int, int, int],
) -> Int64s:
    """Return where the pixels of the groups fall for every turn, (2, G, K, N) int64 pixels u and v.

    Parameters
    ----------
    offsets_u, offsets_v : (G, N) float64
        Pixels of each group from the centre that they share [px].
    centre : (float, float)
        Where that centre is expected [px].
    angles : (K,) float64
        Turns of the search [rad].
    aspect : float
        Metres per pixel along v over those along u.
    limits : (int, int, int, int)
        First and last u, first and last v that the search may read around; places beyond are moved there.
    """
    n_groups, n_pixels = offsets_u.shape
    out = np.empty((2, n_groups, len(angles), n_pixels), np.int64)
    for k in range(len(angles)):
        cos, sin = math.cos(angles[k]), math.sin(angles[k])
        for g in range(n_groups):
            for n in range(n_pixels):
                du, dv = offsets_u[g, n], offsets_v[g, n]
                u: int = math.floor(cos * du + sin * aspect * dv + centre[0] + 0.5)
                v: int = math.floor(cos * dv - sin / aspect * du + centre[1] + 0.5)
                out[0, g, k, n] = min(max(u, limits[0]), limits[1])
                out[1, g, k, n] = min(max(v, limits[2]), limits[3])
    return out


def _columns(shift_px: int) -> int:
    """Return the columns of the window that whole vectors cover: all, or all but the last."""
    return 2 * shift_px if 2 * shift_px % LANES == 0 else LANES * -(-(2 * shift_px + 1) // LANES)


def _rows_at_once(shift_px: int) -> int:
    """Return how many rows of the window the registers hold, a divisor of all rows."""
    size, most = 2 * shift_px + 1, max(1, _REGISTERS // (_columns(shift_px) // LANES))
    return max(rows for rows in range(1, most + 1) if size % rows == 0)


@lru_cache
def patch_search(shift_px: int) -> PatchSearch:
    """Return the vector kernel that computes E of Eq. (1) for every group of a patch.

    Returns
    -------
    callable
        ``(image, image_t, spots, values) -> errors``: (H, W) and (W, H) int8 pictures of 7 bits, the
        (2, G, K, N) int64 of `group_places` and (G, N) int8 intensities give the (G, K, J, I) int32 sums of
        absolute differences, j and i from -`shift_px` on.
    """
    size, columns, rows = 2 * shift_px + 1, _columns(shift_px), _rows_at_once(shift_px)
    inner = min(size, columns)

    @kernel
    def search(image: Bits7, image_t: Bits7, spots: Int64s, values: Bits7) -> Int32s:
        height, width = image.shape
        _, n_groups, n_angles, n_pixels = spots.shape
        errors = np.empty((n_groups, n_angles, size, size), np.int32)
        window, leftover = np.empty((size, columns), np.int32), np.empty((1, columns), np.int32)
        offsets, offsets_t = np.empty(n_pixels, np.int64), np.empty(n_pixels, np.int64)
        for group in range(n_groups * n_angles):
            g, k = group // n_angles, group % n_angles
            for n in range(n_pixels):
                u, v = spots[0, g, k, n] - shift_px, spots[1, g, k, n] - shift_px
                offsets[n], offsets_t[n] = v * width + u, (u + columns) * height + v
            window.fill(0)
            leftover.fill(0)
            for start in range(0, n_pixels // 2, PAIRS):
                stop = min(start + PAIRS, n_pixels // 2)
                for j in range(0, size, rows):
                    add_pairs(rows, columns, image, j * width, offsets, values[g], start, stop, window, j * columns)
                if columns < size:
                    add_pairs(1, columns, image_t, 0, offsets_t, values[g], start, stop, leftover, 0)
            corner = np.int32(0)
            if columns < size:
                for n in range(n_pixels // 2 * 2):
                    u, v = spots[0, g, k, n] + shift_px, spots[1, g, k, n] + shift_px
                    corner += abs(np.int32(values[g, n]) - np.int32(image[v, u]))
            for j in range(size):
                for i in range(inner):
                    errors[g, k, j, i] = window[j, i]
                if columns < size:
                    errors[g, k, j, columns] = leftover[0, j] if j < columns else corner
            for n in range(n_pixels // 2 * 2, n_pixels):  # the last of an odd number
                u, v = spots[0, g, k, n] - shift_px, spots[1, g, k, n] - shift_px
                for j in range(size):
                    for i in range(size):
                        errors[g, k, j, i] += abs(np.int32(values[g, n]) - np.int32(image[v + j, u + i]))
        return errors

    return search


@lru_cache
def patch_search_plain(shift_px: int) -> PatchSearch:
    """Return a kernel that does what `patch_search` does, without vectors."""
    size = 2 * shift_px + 1

    @kernel
    def search(image: Bits7, image_t: Bits7, spots: Int64s, values: Bits7) -> Int32s:
        _, n_groups, n_angles, n_pixels = spots.shape
        errors = np.zeros((n_groups, n_angles, size, size), np.int32)
        for g in range(n_groups):
            for k in range(n_angles):
                for n in range(n_pixels):
                    value = np.int32(values[g, n])
                    left, top = spots[0, g, k, n] - shift_px, spots[1, g, k, n] - shift_px
                    for j in range(size):
                        row = image[top + j, left : left + size]
                        for i in range(size):  # int32: in 8 bits numba would leave the vector registers
                            errors[g, k, j, i] += abs(np.int32(row[i]) - value)
        return errors

    return search
