"""Groups of reference pixels: the darkest and brightest of each vertical line (Nagai & Watanabe 2015, Sec. II-A).

A group stays in its tracking area: a pixel that leaves it on one side jumps to the other, where a new pixel of the
same kind is chosen. Only then is its intensity I(n) taken anew, so that the group is a key frame that rolls along.

Jumping to the extreme of the new line is not enough: as soon as the robot turns, two pixels come to land on one line,
are the same pixel then, and stay it. Of 768 pixels 20 would be left after 13 m. Each line therefore takes one
pixel of each kind.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trailmark.arrays import Bools, Floats, Grey8
from trailmark.kernels import inner_kernel, kernel

__all__ = ["Area", "Group", "advance", "select"]

#: Left, top, right and bottom of a tracking area [px]; right and bottom lie outside.
Area = tuple[int, int, int, int]

#: How far to both sides a pixel that jumped looks for a free line; and, over the upper or lower edge, for an extreme:
#: over the whole line all of them would choose the same one.
_REACH_PX = 16

Floats = Floats


class Group(NamedTuple):
    """Reference pixels. Kernels take and give the fields one by one: numba is slow to make named tuples.

    Attributes
    ----------
    x, y : (N,) float64
        Coordinates T [px].
    values : (N,) uint8
        Intensities I.
    brightest : (N,) bool
        Kind of the pixel: maximum or minimum of its line.
    """

    x: Floats
    y: Floats
    values: Grey8
    brightest: Bools


@inner_kernel
def _is_better(value: int, best: int, brightest: bool) -> bool:
    return value > best if brightest else value < best


@inner_kernel
def _extreme_in_column(image: Grey8, u: int, top: int, bottom: int, brightest: bool) -> int:
    best = top
    for v in range(top + 1, bottom):
        if _is_better(image[v, u], image[best, u], brightest):
            best = v
    return best


@inner_kernel
def _free_line(taken: Bools, u: int, area: Area) -> int:
    """Return the free line nearest to column `u`, or `u`."""
    for distance in range(_REACH_PX + 1):
        for side in (1, -1):
            near = u + side * distance
            if area[0] <= near < area[2] and not taken[_line_of(near, area, len(taken))]:
                return near
    return u


@inner_kernel
def _extreme_in_row(image: Grey8, u: int, v: int, area: Area, brightest: bool, taken: Bools) -> int:
    """Return the column of the extreme of a row near column `u`: on a free line, or on any where none is free."""
    first, last = max(area[0], u - _REACH_PX), min(area[2], u + _REACH_PX + 1)
    best, best_of_all = -1, first
    for near in range(first, last):
        if _is_better(image[v, near], image[v, best_of_all], brightest):
            best_of_all = near
        if taken[_line_of(near, area, len(taken))]:
            continue
        if best < 0 or _is_better(image[v, near], image[v, best], brightest):
            best = near
    return best if best >= 0 else best_of_all


@inner_kernel
def _line_of(u: int, area: Area, n_lines: int) -> int:
    return (u - area[0]) * n_lines // (area[2] - area[0])


@kernel
def select(image: Grey8, area: Area, n_pixels: int) -> tuple[Floats, Floats, Grey8, Bools]:
    """Return the fields of the initial group: maximum and minimum of `n_pixels` / 2 vertical lines, evenly spread."""
    left, top, right, bottom = area
    x, y = np.empty(n_pixels, np.float64), np.empty(n_pixels, np.float64)
    values, brightest = np.empty(n_pixels, np.uint8), np.empty(n_pixels, np.bool_)
    for n in range(n_pixels):
        u = left + (n // 2) * (right - left) // (n_pixels // 2)
        brightest[n] = n % 2 == 0
        v = _extreme_in_column(image, u, top, bottom, brightest[n])
        x[n], y[n], values[n] = u, v, image[v, u]
    return x, y, values, brightest


@kernel
def advance(
    image: Grey8,
    group_x: Floats,
    group_y: Floats,
    group_values: Grey8,
    brightest: Bools,
    area: Area,
    centre: tuple[float, float],
    motion: tuple[float, float, float],
    aspect: float,
    grid: float,
) -> tuple[Floats, Floats, Grey8, Bools]:
    """Move a group with the picture and let the pixels that leave the area jump.

    Parameters
    ----------
    image : (H, W) uint8
        The picture that the group has been found in.
    group_x, group_y, group_values, brightest
        The fields of the group before the motion.
    area : Area
        Its tracking area.
    centre : (float, float)
        Centre of rotation O [px].
    motion : (float, float, float)
        Shift and turn of the content about `centre` [px, px, rad].
    aspect : float
        Metres per pixel along v over those along u.
    grid : float
        Steps per pixel that coordinates are rounded to: 128 for the 7 bits of the paper; 0: not rounded.

    Returns
    -------
    x, y, values
        The fields of the group after the motion.
    fresh : (N,) bool
        Pixels that have jumped.
    """
    left, top, right, bottom = area
    cos, sin = math.cos(motion[2]), math.sin(motion[2])
    to_x, to_y = centre[0] + motion[0], centre[1] + motion[1]
    n_pixels = len(group_x)
    x, y, values = np.empty(n_pixels, np.float64), np.empty(n_pixels, np.float64), group_values.copy()
    fresh, taken = np.zeros(n_pixels, np.bool_), np.zeros((2, n_pixels // 2), np.bool_)
    for n in range(n_pixels):
        dx, dy = group_x[n] - centre[0], group_y[n] - centre[1]
        x[n] = cos * dx + sin * aspect * dy + to_x
        y[n] = cos * dy - sin / aspect * dx + to_y
        if grid > 0.0:
            x[n], y[n] = np.rint(x[n] * grid) / grid, np.rint(y[n] * grid) / grid
        u, v = math.floor(x[n] + 0.5), math.floor(y[n] + 0.5)
        fresh[n] = not (left <= u < right and top <= v < bottom)
        if not fresh[n]:
            taken[int(brightest[n]), _line_of(u, area, n_pixels // 2)] = True
    for n in range(n_pixels):
        if not fresh[n]:
            continue
        u, v = math.floor(x[n] + 0.5), math.floor(y[n] + 0.5)
        lines = taken[int(brightest[n])]
        if not left <= u < right:
            u += right - left if u < left else left - right
            u = _free_line(lines, min(max(u, left), right - 1), area)
            v = _extreme_in_column(image, u, top, bottom, brightest[n])
        else:
            v += bottom - top if v < top else top - bottom
            v = min(max(v, top), bottom - 1)
            u = _extreme_in_row(image, u, v, area, brightest[n], lines)
        lines[_line_of(u, area, n_pixels // 2)] = True
        x[n], y[n], values[n] = u, v, image[v, u]
    return x, y, values, fresh
