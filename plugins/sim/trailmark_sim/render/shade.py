"""The kernel that gives each ray its light: texture, baked light, highlights, sky."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from trailmark_sim.render.rays import LANES
from trailmark_sim.render.shapes import CYLINDER, RECTANGLE

__all__ = ["shade_tiles"]

_MOST_TAPS = 4
_F: Any = np.float32
Rgb = tuple[Any, Any, Any]
_ZERO, _HALF, _ONE, _TWO, _EIGHT = _F(0.0), _F(0.5), _F(1.0), _F(2.0), _F(8.0)
_TURN = _F(1.0 / (2.0 * math.pi))
_LOW, _MIDDLE, _HIGH, _BITS21 = (np.uint64(n) for n in (0xFF, 0xFF00, 0xFF0000, 0x1FFFFF))
_S13, _S21, _S26, _S42 = (np.uint64(n) for n in (13, 21, 26, 42))
_PER_MANTISSA = _F(1.0 / (1 << 23))
_WEIGHT = 1022  # four texels of 255 with these weights, eight times, stay below 2^21
_PER_BYTE = _F(1.0 / 255.0)
_HIGHLIGHT = _F(6.0)

_kernel = njit(cache=True, nogil=True, error_model="numpy")


@_kernel
def shade_tiles(
    first: int,
    last: int,
    rays: npt.NDArray[Any],
    pixels: npt.NDArray[Any],
    pixel_rad: npt.NDArray[Any],
    ranges: npt.NDArray[Any],
    hits: npt.NDArray[Any],
    kinds: npt.NDArray[Any],
    frames: npt.NDArray[Any],
    eyes: npt.NDArray[Any],
    looks: npt.NDArray[Any],
    textures: npt.NDArray[Any],
    floors: npt.NDArray[Any],
    light: npt.NDArray[Any],
    patches: npt.NDArray[Any],
    texels: npt.NDArray[Any],
    starts: npt.NDArray[Any],
    sizes: npt.NDArray[Any],
    sky: npt.NDArray[Any],
    to_map: npt.NDArray[Any],
    key: npt.NDArray[Any],
    shadows: npt.NDArray[Any],
    out: npt.NDArray[Any],
) -> None:
    """Give the rays of some tiles their light.

    Parameters
    ----------
    first, last : int
        Tiles `first` to `last` (without it) are done.
    rays, pixels, pixel_rad
        Of the `RayTable`.
    ranges, hits
        From `cast_tiles`.
    kinds, frames, eyes
        As in `cast_tiles`.
    looks, textures, floors, light, patches, sky
        Of the `Scene`.
    texels, starts, sizes
        Of its `Atlas`.
    to_map : (4, 3) float32
        Rotation from the camera's axes to the map, and the eye.
    key : (3,) float32
        Direction to the key light, in the map.
    shadows : (K, 4) float32
        Soft round shadows on floors: x, y, radius [m], depth.
    out : (H * W, 3) float32
        Receives red, green and blue: 1 is a white wall in unit light.
    """
    for tile in range(first, last):
        for lane in range(LANES):
            pixel = pixels[tile, lane]
            if pixel < 0:
                continue
            dx, dy, dz = rays[tile, 0, lane], rays[tile, 1, lane], rays[tile, 2, lane]
            p = hits[tile, lane]
            if p < 0:
                _sky_light(out, pixel, dx, dy, dz, to_map, sky)
                continue
            t = ranges[tile, lane]
            m0 = frames[p, 0, 0] * dx + frames[p, 0, 1] * dy + frames[p, 0, 2] * dz
            m1 = frames[p, 1, 0] * dx + frames[p, 1, 1] * dy + frames[p, 1, 2] * dz
            m2 = frames[p, 2, 0] * dx + frames[p, 2, 1] * dy + frames[p, 2, 2] * dz
            l0, l1, l2 = eyes[p, 0] + t * m0, eyes[p, 1] + t * m1, eyes[p, 2] + t * m2
            foot_m = t * pixel_rad[tile]
            u, v, step_u, step_v, n_taps = l1, l2, _ZERO, _ZERO, 1
            if kinds[p] == RECTANGLE:
                cosine = min(_ONE, max(_F(0.02), abs(m0)))
                stretch = min(_EIGHT, _ONE / cosine)
                n_taps = min(_MOST_TAPS, int(stretch + _F(0.6)))
                sine = math.sqrt(max(_F(1e-6), _ONE - cosine * cosine))
                step_u, step_v = m1 * foot_m * stretch / sine, m2 * foot_m * stretch / sine
                foot_m *= max(_ONE, stretch / _F(_MOST_TAPS))
            else:
                u = math.atan2(l2, l1) * _TURN + _HALF
                v = l0 if kinds[p] == CYLINDER else (l0 + _ONE) * _HALF
            red, green, blue = _texture(
                texels, starts, sizes, textures[p], looks, p, u, v, step_u, step_v, n_taps, foot_m * looks[p, 7]
            )
            shade = _shadow(t, dx, dy, to_map, dz, shadows) if floors[p] else _ONE
            lr, lg, lb = _baked(light, patches, p, u, v, kinds[p] != RECTANGLE)
            gloss = _ZERO
            if looks[p, 6] > _ZERO:
                gloss = looks[p, 6] * _mirrored(dx, dy, dz, frames, p, l0, l1, l2, kinds[p], to_map, key)
            out[pixel, 0] = looks[p, 2] * red * (lr * shade + looks[p, 5]) + gloss * lr
            out[pixel, 1] = looks[p, 3] * green * (lg * shade + looks[p, 5]) + gloss * lg
            out[pixel, 2] = looks[p, 4] * blue * (lb * shade + looks[p, 5]) + gloss * lb


@_kernel
def _texture(
    texels: npt.NDArray[Any],
    starts: npt.NDArray[Any],
    sizes: npt.NDArray[Any],
    number: Any,
    looks: npt.NDArray[Any],
    p: int,
    u: Any,
    v: Any,
    step_u: Any,
    step_v: Any,
    n_taps: int,
    foot: Any,
) -> Rgb:
    """Return the reflectance under a pixel: means of up to four places along its footprint, on two mip levels."""
    width, height, n_levels = sizes[number, 0], sizes[number, 1], sizes[number, 2]
    if n_levels == 1:
        return _reflectance(_spread(texels[starts[number, 0]]), _PER_BYTE)
    # The exponent of a float is its logarithm, the rest of its bits nearly the fraction: ten times as fast as log2.
    bits = _F(max(foot, _ONE)).view(np.int32)
    low = min((bits >> 23) - 127, n_levels - 1)
    rest = _F(bits & 0x7FFFFF) * _PER_MANTISSA
    high = min(low + 1, n_levels - 1)
    # Most pixels need one level only; between two the change is quick but not sudden.
    part = min(_ONE, max(_ZERO, rest * _F(3.0) - _ONE))
    share = _ONE / _F(n_taps)
    fine, coarse = np.uint64(0), np.uint64(0)
    for tap in range(n_taps):
        along = (_F(tap) + _HALF) * share - _HALF
        x = (u + along * step_u) * looks[p, 0] * _F(width)
        y = (_ONE - (v + along * step_v)) * looks[p, 1] * _F(height)
        if part < _ONE:
            fine += _bilinear(texels, starts[number, low], width, height, low, x, y)
        if part > _ZERO:
            coarse += _bilinear(texels, starts[number, high], width, height, high, x, y)
    scale = _PER_BYTE * share / _F(_WEIGHT)
    if part <= _ZERO:
        return _reflectance(fine, scale)
    red, green, blue = _reflectance(coarse, scale)
    if part >= _ONE:
        return red, green, blue
    r, g, b = _reflectance(fine, scale)
    return r + part * (red - r), g + part * (green - g), b + part * (blue - b)


# Red, green and blue are summed in one 64-bit number, 21 bits each: a byte, a weight of ten bits, and three bits
# for up to four places on the way.


@_kernel
def _spread(texel: np.uint32) -> np.uint64:
    wide = np.uint64(texel)
    return (wide & _LOW) | ((wide & _MIDDLE) << _S13) | ((wide & _HIGH) << _S26)


@_kernel
def _reflectance(total: np.uint64, scale: Any) -> Rgb:
    red = _F(np.int32(total & _BITS21)) * scale
    green = _F(np.int32((total >> _S21) & _BITS21)) * scale
    blue = _F(np.int32(total >> _S42)) * scale
    return red * red, green * green, blue * blue


@_kernel
def _bilinear(texels: npt.NDArray[Any], start: int, width: int, height: int, level: int, x: Any, y: Any) -> np.uint64:
    """Return the weighted sum of four texels about a place of the largest level, read from another level."""
    scale = _ONE / _F(1 << level)
    x, y = x * scale - _HALF, y * scale - _HALF
    wide, high = max(1, width >> level), max(1, height >> level)
    floor_x, floor_y = math.floor(x), math.floor(y)
    fx, fy = x - _F(floor_x), y - _F(floor_y)
    i, j = np.int64(floor_x), np.int64(floor_y)
    i0, i1, j0, j1 = i & (wide - 1), (i + 1) & (wide - 1), (j & (high - 1)) * wide, ((j + 1) & (high - 1)) * wide
    a, b = _spread(texels[start + j0 + i0]), _spread(texels[start + j0 + i1])
    c, d = _spread(texels[start + j1 + i0]), _spread(texels[start + j1 + i1])
    both = fx * fy
    wb = np.uint64(np.int32((fx - both) * _F(_WEIGHT)))
    wc = np.uint64(np.int32((fy - both) * _F(_WEIGHT)))
    wd = np.uint64(np.int32(both * _F(_WEIGHT)))
    return a * (np.uint64(_WEIGHT) - wb - wc - wd) + b * wb + c * wc + d * wd


@_kernel
def _baked(light: npt.NDArray[Any], patches: npt.NDArray[Any], p: int, u: Any, v: Any, is_round: bool) -> Rgb:
    """Return the baked light at a place, bilinear; around a round shape the columns close."""
    start, columns, rows = patches[p, 0], patches[p, 1], patches[p, 2]
    x, y = u * _F(columns) - _HALF, v * _F(rows) - _HALF
    y = min(_F(rows - 1), max(_ZERO, y))
    if not is_round:
        x = min(_F(columns - 1), max(_ZERO, x))
    i, j = math.floor(x), int(y)
    fx, fy = x - _F(i), y - _F(j)
    j1 = min(j + 1, rows - 1)
    i0, i1 = (i % columns, (i + 1) % columns) if is_round else (i, min(i + 1, columns - 1))
    a, b = start + j * columns + i0, start + j * columns + i1
    c, d = start + j1 * columns + i0, start + j1 * columns + i1
    wa, wb, wc, wd = (_ONE - fx) * (_ONE - fy), fx * (_ONE - fy), (_ONE - fx) * fy, fx * fy
    return (
        wa * light[a, 0] + wb * light[b, 0] + wc * light[c, 0] + wd * light[d, 0],
        wa * light[a, 1] + wb * light[b, 1] + wc * light[c, 1] + wd * light[d, 1],
        wa * light[a, 2] + wb * light[b, 2] + wc * light[c, 2] + wd * light[d, 2],
    )


@_kernel
def _shadow(t: Any, dx: Any, dy: Any, to_map: npt.NDArray[Any], dz: Any, shadows: npt.NDArray[Any]) -> Any:
    """Return the light that people leave on the floor."""
    x = to_map[3, 0] + t * (to_map[0, 0] * dx + to_map[0, 1] * dy + to_map[0, 2] * dz)
    y = to_map[3, 1] + t * (to_map[1, 0] * dx + to_map[1, 1] * dy + to_map[1, 2] * dz)
    shade = _ONE
    for k in range(shadows.shape[0]):
        ax, ay = x - shadows[k, 0], y - shadows[k, 1]
        far = (ax * ax + ay * ay) / (shadows[k, 2] * shadows[k, 2])
        if far < _ONE:
            shade *= _ONE - shadows[k, 3] * (_ONE - far) * (_ONE - far)
    return shade


@_kernel
def _mirrored(
    dx: Any,
    dy: Any,
    dz: Any,
    frames: npt.NDArray[Any],
    p: int,
    l0: Any,
    l1: Any,
    l2: Any,
    kind: int,
    to_map: npt.NDArray[Any],
    key: npt.NDArray[Any],
) -> Any:
    """Return what a shiny surface mirrors: a bright spot where the key light is, a paler ceiling or sky."""
    w0, w1, w2 = (_ONE, _ZERO, _ZERO) if kind == RECTANGLE else (_ZERO if kind == CYLINDER else l0, l1, l2)
    nx = w0 * frames[p, 0, 0] + w1 * frames[p, 1, 0] + w2 * frames[p, 2, 0]
    ny = w0 * frames[p, 0, 1] + w1 * frames[p, 1, 1] + w2 * frames[p, 2, 1]
    nz = w0 * frames[p, 0, 2] + w1 * frames[p, 1, 2] + w2 * frames[p, 2, 2]
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / length, ny / length, nz / length
    twice = _TWO * (dx * nx + dy * ny + dz * nz)
    rx, ry, rz = dx - twice * nx, dy - twice * ny, dz - twice * nz
    towards = _ZERO
    for c in range(3):
        towards += key[c] * (to_map[c, 0] * rx + to_map[c, 1] * ry + to_map[c, 2] * rz)
    up = to_map[2, 0] * rx + to_map[2, 1] * ry + to_map[2, 2] * rz
    spot = max(_ZERO, towards)
    for _ in range(5):
        spot *= spot
    return _HIGHLIGHT * spot + _HALF * max(_ZERO, up)


@_kernel
def _sky_light(
    out: npt.NDArray[Any],
    pixel: int,
    dx: Any,
    dy: Any,
    dz: Any,
    to_map: npt.NDArray[Any],
    sky: npt.NDArray[Any],
) -> None:
    """Read the sky off its picture, bilinear."""
    x = to_map[0, 0] * dx + to_map[0, 1] * dy + to_map[0, 2] * dz
    y = to_map[1, 0] * dx + to_map[1, 1] * dy + to_map[1, 2] * dz
    z = to_map[2, 0] * dx + to_map[2, 1] * dy + to_map[2, 2] * dz
    rows, columns = sky.shape[0], sky.shape[1]
    a = (math.atan2(y, x) * _TURN + _HALF) * _F(columns) - _HALF
    b = _F(math.acos(min(_ONE, max(-_ONE, z)))) * _TWO * _TURN * _F(rows) - _HALF
    b = min(_F(rows - 1), max(_ZERO, b))
    i, j = math.floor(a), int(b)
    fx, fy = a - _F(i), b - _F(j)
    i0, i1, j1 = i % columns, (i + 1) % columns, min(j + 1, rows - 1)
    for c in range(3):
        upper = sky[j, i0, c] + fx * (sky[j, i1, c] - sky[j, i0, c])
        lower = sky[j1, i0, c] + fx * (sky[j1, i1, c] - sky[j1, i0, c])
        out[pixel, c] = upper + fy * (lower - upper)
