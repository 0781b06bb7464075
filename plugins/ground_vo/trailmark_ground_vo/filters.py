"""Kernels on whole pictures: transpose, flat field, smoothing; the slow ones with vectors and as plain loops."""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Grey8, Grey16
from trailmark.kernels import kernel
from trailmark_ground_vo.vector import LANES, smooth_across, smooth_down, transpose_block

__all__ = [
    "GAIN_ONE",
    "SMOOTH_SCALE",
    "cell_means",
    "flatten",
    "levels_of",
    "noise_level",
    "smooth",
    "smooth_plain",
    "transpose",
    "transpose_plain",
]

#: A gain of 1 in the fixed-point gains of `flatten`.
GAIN_ONE = 256

#: What `smooth` multiplies grey levels with: the weights 1 4 6 4 1 add up to 16 along each axis.
SMOOTH_SCALE = 256


@kernel
def transpose(image: Grey8) -> Grey8:
    """Return the transposed picture, (W, H) uint8."""
    height, width = image.shape
    out = np.empty((width, height), np.uint8)
    for y in range(0, height - LANES + 1, LANES):
        for x in range(0, width - LANES + 1, LANES):
            transpose_block(image, y * width + x, width, out, x * height + y, height)
    for y in range(height - height % LANES, height):
        for x in range(width):
            out[x, y] = image[y, x]
    for x in range(width - width % LANES, width):
        for y in range(height):
            out[x, y] = image[y, x]
    return out


@kernel
def transpose_plain(image: Grey8) -> Grey8:
    """Return the transposed picture, (W, H) uint8, without vectors."""
    height, width = image.shape
    out = np.empty((width, height), np.uint8)
    for x in range(width):
        for y in range(height):
            out[x, y] = image[y, x]
    return out


@kernel
def flatten(image: Grey8, gain: Grey16) -> Grey8:
    """Return ``round(image * gain / 256)``, at most 255.

    Parameters
    ----------
    image : (H, W) uint8
        Picture.
    gain : (H, W) uint16
        Gain of each pixel, `GAIN_ONE` for 1.
    """
    height, width = image.shape
    out = np.empty((height, width), np.uint8)
    for y in range(height):
        for x in range(width):  # int32: in 16 bits numba would leave the vector registers
            level = (np.int32(image[y, x]) * np.int32(gain[y, x]) + np.int32(128)) >> np.int32(8)
            out[y, x] = min(np.int32(255), level)
    return out


@kernel
def cell_means(image: Grey8, side: int) -> Grey8:
    """Return the means of square cells, (H // side, W // side) uint8; what is left over at the edges is left out."""
    rows, columns = image.shape[0] // side, image.shape[1] // side
    out = np.empty((rows, columns), np.uint8)
    sums = np.empty(columns * side, np.int32)
    for row in range(rows):
        sums[:] = 0
        for y in range(row * side, (row + 1) * side):
            line = image[y]
            for x in range(columns * side):
                sums[x] += np.int32(line[x])
        for column in range(columns):
            total = np.int32(0)
            for x in range(column * side, (column + 1) * side):
                total += sums[x]
            out[row, column] = total // (side * side)
    return out


@kernel
def smooth(image: Grey8) -> Grey16:
    """Return 256 times the picture smoothed with the weights 1 4 6 4 1 along both axes, edges repeated.

    Exact: 256 * 255 still fits into 16 bits.
    """
    height, width = image.shape
    out = np.empty((height, width), np.uint16)
    line = np.empty(width + 4, np.uint16)
    last = height - 1
    for y in range(height):
        rows = (
            max(y - 2, 0) * width,
            max(y - 1, 0) * width,
            y * width,
            min(y + 1, last) * width,
            min(y + 2, last) * width,
        )
        for x in range(0, width - LANES + 1, LANES):
            smooth_down(image, rows, x, line, x + 2)
        if width % LANES:
            smooth_down(image, rows, width - LANES, line, width - LANES + 2)
        line[0] = line[1] = line[2]
        line[width + 2] = line[width + 3] = line[width + 1]
        for x in range(0, width - LANES + 1, LANES):
            smooth_across(line, x + 2, out, y * width + x)
        if width % LANES:
            smooth_across(line, width - LANES + 2, out, y * width + width - LANES)
    return out


@kernel
def levels_of(smoothed: Grey16) -> Grey8:
    """Return what `smooth` gave in whole grey levels, (H, W) uint8."""
    height, width = smoothed.shape
    out = np.empty((height, width), np.uint8)
    for y in range(height):
        for x in range(width):  # int32: in 16 bits numba would leave the vector registers
            out[y, x] = (np.int32(smoothed[y, x]) + np.int32(SMOOTH_SCALE // 2)) >> np.int32(8)
    return out


@kernel
def noise_level(image: Grey8) -> float:
    """Return the standard deviation of the noise of a picture, more where the ground is fine [grey levels].

    From the differences of second differences along both axes, which hardly see edges and slopes (Immerkaer, Fast Noise
    Variance Estimation, 1996), on every fourth row.
    """
    height, width = image.shape
    total, n = np.int64(0), 0
    for y in range(1, height - 1, 4):
        above, middle, below = image[y - 1], image[y], image[y + 1]
        row = np.int32(0)
        for x in range(1, width - 1):
            corners = np.int32(above[x - 1]) + np.int32(above[x + 1]) + np.int32(below[x - 1]) + np.int32(below[x + 1])
            sides = np.int32(above[x]) + np.int32(below[x]) + np.int32(middle[x - 1]) + np.int32(middle[x + 1])
            row += abs(corners - np.int32(2) * sides + np.int32(4) * np.int32(middle[x]))
        total += row
        n += width - 2
    return math.sqrt(math.pi / 2.0) / 6.0 * total / max(n, 1)


@kernel
def smooth_plain(image: Grey8) -> Grey16:
    """Do what `smooth` does, without vectors."""
    height, width = image.shape
    out = np.empty((height, width), np.uint16)
    line = np.empty(width + 4, np.int32)
    last = height - 1
    for y in range(height):
        above, before = image[max(y - 2, 0)], image[max(y - 1, 0)]
        after, below = image[min(y + 1, last)], image[min(y + 2, last)]
        middle = image[y]
        for x in range(width):
            outer = np.int32(above[x]) + np.int32(below[x])
            inner = np.int32(before[x]) + np.int32(after[x])
            line[x + 2] = outer + 4 * inner + 6 * np.int32(middle[x])
        line[0] = line[1] = line[2]
        line[width + 2] = line[width + 3] = line[width + 1]
        for x in range(width):
            out[y, x] = line[x] + line[x + 4] + 4 * (line[x + 1] + line[x + 3]) + 6 * line[x + 2]
    return out
