"""Pixels for the refinement: steep ones, spread evenly, that remember what they looked like.

The search wants extremes, whose absolute difference has a sharp minimum; there the slope vanishes, so that they
say little about fractions of a pixel. The refinement therefore has its own pixels: in every segment of a vertical
line the one with the steepest slope along u and the one along v. They live on the smoothed picture and roll along
like the groups of the search, each to a cell of line and segment that has none of its kind. While a pixel lives, its
intensity is averaged over the pictures that it was seen in: the noise of the one picture that it was chosen in is
what heading and position would drift with.
"""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Bools, Float32s, Grey16
from trailmark.kernels import float_kernel, inner_kernel, kernel
from trailmark_ground_vo.extremes import Area

__all__ = [
    "AGE",
    "SEEN_X",
    "SEEN_Y",
    "SLOPE_U",
    "SLOPE_V",
    "VALUE",
    "Texture",
    "X",
    "Y",
    "advance_texture",
    "learn_anew",
    "residuals",
    "select_texture",
]

#: Rows of a texture: coordinates [px]; what the pixel looks like and its slopes [1/px], in units of the smoothed
#: picture; pictures that the look is averaged over, and the mean of the coordinates where it was seen in them [px].
X, Y, VALUE, SLOPE_U, SLOPE_V, AGE, SEEN_X, SEEN_Y = range(8)

#: How far to both sides a pixel that jumped looks for a free cell [px].
_REACH_PX = 16


#: Remembered pixels, (8, N) float32, a row for each of the names above. Pixel n is steep along u when n is even, and
#: stays so when it jumps.
Texture = Float32s


@inner_kernel
def _slope(picture: Grey16, u: int, v: int, along_u: bool) -> np.int32:
    if along_u:  # signed, or numba would wrap below zero
        return np.int32(picture[v, u + 1]) - np.int32(picture[v, u - 1])
    return np.int32(picture[v + 1, u]) - np.int32(picture[v - 1, u])


@inner_kernel
def _steepest_in_column(picture: Grey16, u: int, top: int, bottom: int, along_u: bool) -> int:
    best, steepest = top, np.int32(-1)
    for v in range(top, bottom):
        slope = abs(_slope(picture, u, v, along_u))
        if slope > steepest:
            best, steepest = v, slope
    return best


@inner_kernel
def _put(texture: Texture, n: int, picture: Grey16, u: int, v: int) -> None:
    texture[X, n], texture[Y, n], texture[VALUE, n] = u, v, picture[v, u]
    texture[SLOPE_U, n] = 0.5 * _slope(picture, u, v, True)
    texture[SLOPE_V, n] = 0.5 * _slope(picture, u, v, False)
    texture[AGE, n], texture[SEEN_X, n], texture[SEEN_Y, n] = 1.0, u, v


@inner_kernel
def _learn_anew(texture: Texture, n: int, picture: Grey16, value: float, u: int, v: int) -> None:
    """Remember a pixel as it looks now, where it is."""
    texture[VALUE, n], texture[AGE, n] = value, 1.0
    texture[SLOPE_U, n] = 0.5 * _slope(picture, u, v, True)
    texture[SLOPE_V, n] = 0.5 * _slope(picture, u, v, False)
    texture[SEEN_X, n], texture[SEEN_Y, n] = texture[X, n], texture[Y, n]


@kernel
def learn_anew(picture: Grey16, texture: Texture, where: Bools) -> None:
    """Remember some pixels as they look in a picture now, where they are; `texture` is changed.

    Parameters
    ----------
    picture : (H, W) uint16
        Smoothed.
    texture : (8, N) float32
        In the coordinates of the picture.
    where : (N,) bool
        Which ones.
    """
    height, width = picture.shape
    for n in range(texture.shape[1]):
        if not where[n]:
            continue
        x, y = texture[X, n], texture[Y, n]
        u, v = min(max(int(x), 1), width - 3), min(max(int(y), 1), height - 3)
        a, b = x - u, y - v
        above = (1.0 - a) * picture[v, u] + a * picture[v, u + 1]
        below = (1.0 - a) * picture[v + 1, u] + a * picture[v + 1, u + 1]
        nearest_u, nearest_v = min(max(int(x + 0.5), 1), width - 2), min(max(int(y + 0.5), 1), height - 2)
        _learn_anew(texture, n, picture, (1.0 - b) * above + b * below, nearest_u, nearest_v)


@kernel
def select_texture(picture: Grey16, area: Area, n_segments: int, step_px: int) -> Texture:
    """Return the initial pixels: of every `step_px`-th line and each of its segments the steepest along u and v.

    Parameters
    ----------
    picture : (H, W) uint16
        The picture, smoothed.
    area : Area
        Where pixels are chosen.
    n_segments : int
        Segments of a line; of each, two pixels.
    step_px : int
        Distance of the lines [px].

    Returns
    -------
    (8, N) float32
        The pixels.
    """
    left, top, right, bottom = area
    height = (bottom - top) // n_segments
    texture = np.empty((8, 2 * n_segments * ((right - left) // step_px)), np.float32)
    for n in range(texture.shape[1]):
        u = left + n // (2 * n_segments) * step_px
        first = top + n // 2 % n_segments * height
        _put(texture, n, picture, u, _steepest_in_column(picture, u, first, first + height, n % 2 == 0))
    return texture


@inner_kernel
def _free_cell(taken: Bools, u: int, segment: int, n_tried: int, left: int, right: int) -> tuple[int, int]:
    """Return column and segment of the free cell nearest to a column, own segment first; or where it was."""
    n_segments, n_lines = taken.shape
    for distance in range(_REACH_PX + 1):
        for side in (1, -1):
            near = u + side * distance
            if not left <= near < right:
                continue
            line = (near - left) * n_lines // (right - left)
            for other in range(n_tried):
                wanted = (segment + other) % n_segments
                if not taken[wanted, line]:
                    return near, wanted
    return u, segment


@inner_kernel
def _rows_of(segment: int, n_segments: int, top: int, bottom: int) -> tuple[int, int]:
    height = (bottom - top) // n_segments
    first = top + segment * height
    return first, bottom if segment == n_segments - 1 else first + height


@inner_kernel
def _new_rows(v: int, segment: int, n_segments: int, top: int, bottom: int) -> tuple[int, int]:
    """Return the rows at the edge that came into the area while a pixel went out to row `v` beyond the other one."""
    first, last = _rows_of(segment, n_segments, top, bottom)
    if v < top:
        return max(first, last - (top - v) - 1), last
    return first, min(last, first + (v - bottom) + 2)


@float_kernel
def residuals(
    picture: Grey16, texture: Texture, centre: tuple[float, float], motion: tuple[float, float, float], aspect: float
) -> Float32s:
    """Return picture minus remembered value at every pixel after a motion (bilinear), (N,) float32.

    Coordinates beyond the edge of the picture are moved inside.

    Parameters
    ----------
    picture : (H, W) uint16
        The new picture, smoothed.
    texture : (8, N) float32
        The remembered pixels.
    centre : (float, float)
        Centre of the turn [px].
    motion : (float, float, float)
        Shift and turn [px, px, rad].
    aspect : float
        Metres per pixel along v over those along u.

    Returns
    -------
    (N,) float32
        Residuals [grey levels].
    """
    height, width = picture.shape
    pixels = picture.reshape(-1)
    cos = np.float32(math.cos(motion[2]))
    across, down = np.float32(math.sin(motion[2]) * aspect), np.float32(math.sin(motion[2]) / aspect)
    from_x, from_y = np.float32(centre[0]), np.float32(centre[1])
    to_x, to_y = np.float32(centre[0] + motion[0]), np.float32(centre[1] + motion[1])
    last_u, last_v, stride = np.int32(width - 2), np.int32(height - 2), np.int32(width)
    n_pixels = texture.shape[1]
    corners = np.empty(n_pixels, np.int32)
    fractions_u, fractions_v = np.empty(n_pixels, np.float32), np.empty(n_pixels, np.float32)
    for n in range(n_pixels):  # two loops: this one runs in vectors, the one that looks up cannot
        dx, dy = texture[X, n] - from_x, texture[Y, n] - from_y
        x, y = cos * dx + across * dy + to_x, cos * dy - down * dx + to_y
        u, v = min(max(np.int32(x), np.int32(0)), last_u), min(max(np.int32(y), np.int32(0)), last_v)
        fractions_u[n], fractions_v[n], corners[n] = x - np.float32(u), y - np.float32(v), v * stride + u
    out = np.empty(n_pixels, np.float32)
    for n in range(n_pixels):
        upper = np.uintp(corners[n])  # unsigned: numba need not ask whether it counts from the end
        lower = upper + np.uintp(width)
        a, b = np.float32(np.int32(pixels[upper])), np.float32(np.int32(pixels[upper + np.uintp(1)]))
        c, d = np.float32(np.int32(pixels[lower])), np.float32(np.int32(pixels[lower + np.uintp(1)]))
        above, below = a + fractions_u[n] * (b - a), c + fractions_u[n] * (d - c)
        out[n] = above + fractions_v[n] * (below - above) - texture[VALUE, n]
    return out


@float_kernel
def _move_texture(
    texture: Texture,
    differences: Float32s,
    centre: tuple[float, float],
    motion: tuple[float, float, float],
    aspect: float,
    memory: float,
    clip: float,
) -> Texture:
    """Return the pixels after a motion, wherever they are; all in float32, so that the loop runs in vectors."""
    cos = np.float32(math.cos(motion[2]))
    across, down = np.float32(math.sin(motion[2]) * aspect), np.float32(math.sin(motion[2]) / aspect)
    from_x, from_y = np.float32(centre[0]), np.float32(centre[1])
    to_x, to_y = np.float32(centre[0] + motion[0]), np.float32(centre[1] + motion[1])
    one, oldest, most = np.float32(1.0), np.float32(memory), np.float32(clip)
    is_averaged = np.float32(1.0 if memory > 1.0 else 0.0)
    out = np.empty_like(texture)
    for n in range(texture.shape[1]):
        dx, dy = texture[X, n] - from_x, texture[Y, n] - from_y
        x, y = cos * dx + across * dy + to_x, cos * dy - down * dx + to_y
        age = min(texture[AGE, n] + one, oldest)
        share = is_averaged / age
        out[X, n], out[Y, n], out[AGE, n] = x, y, age
        out[VALUE, n] = texture[VALUE, n] + share * min(max(differences[n], -most), most)
        out[SLOPE_U, n] = cos * texture[SLOPE_U, n] + down * texture[SLOPE_V, n]
        out[SLOPE_V, n] = cos * texture[SLOPE_V, n] - across * texture[SLOPE_U, n]
        out[SEEN_X, n] = texture[SEEN_X, n] + share * (x - texture[SEEN_X, n])
        out[SEEN_Y, n] = texture[SEEN_Y, n] + share * (y - texture[SEEN_Y, n])
    return out


@float_kernel
def advance_texture(
    picture: Grey16,
    texture: Texture,
    differences: Float32s,
    area: Area,
    n_segments: int,
    centre: tuple[float, float],
    motion: tuple[float, float, float],
    aspect: float,
    memory: float,
    clip: float,
    misfit: float,
) -> tuple[Texture, int]:
    """Move the pixels with the picture, average their grey levels, and choose new ones for those that leave the area.

    Parameters
    ----------
    picture : (H, W) uint16
        The smoothed picture that they have been found in.
    texture : (8, N) float32
        Before the motion.
    differences : (N,) float32
        The `residuals` of the motion.
    area, n_segments
        As in `select_texture`.
    centre, motion, aspect
        As in `extremes.advance`.
    memory : float
        Pictures that a value is averaged over at most; 1 keeps the first.
    clip : float
        Largest difference that enters the average, in units of `picture`.
    misfit : float
        A pixel with a larger difference is remembered anew, as it looks now: something else was seen there, or is.

    Returns
    -------
    texture : (8, N) float32
        After the motion.
    n_fresh : int
        Pixels that have jumped.
    """
    left, top, right, bottom = area
    height = (bottom - top) // n_segments
    out = _move_texture(texture, differences, centre, motion, aspect, memory, clip)
    n_pixels = texture.shape[1]
    n_lines = n_pixels // (2 * n_segments)
    taken, n_fresh = np.zeros((2, n_segments, n_lines), np.bool_), 0
    n_edge = min(1, n_segments)  # no literal: numba would compile what takes it twice
    for n in range(n_pixels):
        u, v = math.floor(out[X, n] + 0.5), math.floor(out[Y, n] + 0.5)
        if left <= u < right and top <= v < bottom:
            if abs(differences[n]) > misfit:
                _learn_anew(out, n, picture, texture[VALUE, n] + differences[n], u, v)
            taken[n % 2, min((v - top) // height, n_segments - 1), (u - left) * n_lines // (right - left)] = True
    for n in range(n_pixels):
        u, v = math.floor(out[X, n] + 0.5), math.floor(out[Y, n] + 0.5)
        if left <= u < right and top <= v < bottom:
            continue
        n_fresh += 1
        cells = taken[n % 2]
        if left <= u < right:
            segment = 0 if v >= bottom else n_segments - 1
            u, segment = _free_cell(cells, u, segment, n_edge, left, right)
            first, last = _new_rows(v, segment, n_segments, top, bottom)
        else:
            u += right - left if u < left else left - right
            u, segment = _free_cell(cells, min(max(u, left), right - 1), n // 2 % n_segments, n_segments, left, right)
            first, last = _rows_of(segment, n_segments, top, bottom)
        cells[segment, (u - left) * n_lines // (right - left)] = True
        _put(out, n, picture, u, _steepest_in_column(picture, u, first, last, n % 2 == 0))
    return out, n_fresh
