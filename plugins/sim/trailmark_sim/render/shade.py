"""The kernel that gives each ray its light: texture, baked light, highlights, sky.

The rays of a tile are done surface by surface, in loops without branches over all 64 of them: most tiles show one or
two surfaces, and eight or sixteen rays are done at once. What is computed for rays that meet something else is thrown
away; their range counts as 0, so that every number stays finite.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import carray, njit  # type: ignore[attr-defined]

from trailmark_sim.render.lanes import float_lanes, int_lanes
from trailmark_sim.render.rays import LANES
from trailmark_sim.render.shapes import CYLINDER, RECTANGLE

__all__ = ["shade_tiles"]

_F: Any = np.float32
_I: Any = np.int32
_ZERO, _HALF, _ONE, _TWO, _EIGHT = _F(0.0), _F(0.5), _F(1.0), _F(2.0), _F(8.0)
_TURN = _F(1.0 / (2.0 * math.pi))
_PER_MANTISSA = _F(1.0 / (1 << 23))
_HIGHLIGHT = _F(6.0)
#: Four places of a pixel's footprint, none above or beside another: each axis sees four places a quarter apart.
_N_TAPS = 4
_ALONG = np.array([-0.375, -0.125, 0.125, 0.375], np.float32)
_ACROSS = np.array([0.125, -0.375, 0.375, -0.125], np.float32)
_PER_TAP = _F(1.0 / (255.0 * 255.0 * _N_TAPS))
#: Size of the texels that are read over the footprint's short side. With the four places a pixel then has 0.35 to
#: 0.5 px of blur (one standard deviation) and edges keep their place within a few hundredths of a pixel.
_TEXEL_PX = _F(0.8)
#: With texels larger than so many footprints one place in the middle does.
_LARGE = _F(4.0)

_kernel = njit(cache=True, nogil=True, error_model="numpy")
_inlined = njit(nogil=True, error_model="numpy", inline="always")
_LANES = (LANES,)


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
    surfaces = carray(int_lanes(), _LANES)
    u, v, foot = carray(float_lanes(), _LANES), carray(float_lanes(), _LANES), carray(float_lanes(), _LANES)
    ax, ay, bx, by = (
        carray(float_lanes(), _LANES),
        carray(float_lanes(), _LANES),
        carray(float_lanes(), _LANES),
        carray(float_lanes(), _LANES),
    )
    x, y, wx, wy = (
        carray(float_lanes(), _LANES),
        carray(float_lanes(), _LANES),
        carray(float_lanes(), _LANES),
        carray(float_lanes(), _LANES),
    )
    red, green, blue = carray(float_lanes(), _LANES), carray(float_lanes(), _LANES), carray(float_lanes(), _LANES)
    lr, lg, lb = carray(float_lanes(), _LANES), carray(float_lanes(), _LANES), carray(float_lanes(), _LANES)
    part, shade = carray(float_lanes(), _LANES), carray(float_lanes(), _LANES)
    level = carray(int_lanes(), _LANES)
    at = (
        carray(int_lanes(), _LANES),
        carray(int_lanes(), _LANES),
        carray(int_lanes(), _LANES),
        carray(int_lanes(), _LANES),
    )
    for tile in range(first, last):
        hit, ray, far = hits[tile], rays[tile], ranges[tile]
        for number in range(_distinct(hit, surfaces)):
            p = surfaces[number]
            if p < 0:
                _sky_lanes(out, pixels[tile], hit, ray, to_map, sky)
                continue
            is_flat = kinds[p] == RECTANGLE
            n = textures[p]
            if is_flat:
                _place_flat(p, hit, ray, far, frames[p], eyes[p], pixel_rad[tile], u, v, foot, ax, ay, bx, by)
            else:
                size = (looks[p, 0] * _F(sizes[n, 0]), looks[p, 1] * _F(sizes[n, 1]))
                _place_round(
                    p, hit, ray, far, frames[p], eyes[p], kinds[p], pixel_rad[tile], looks[p, 7], size,
                    u, v, foot, ax, ay, bx, by,
                )  # fmt: skip
            if sizes[n, 2] == 1:
                _plain(texels[starts[n, 0]], red, green, blue)
            else:
                _textured(
                    texels, starts[n], sizes[n], looks[p], u, v, foot, ax, ay, bx, by,
                    x, y, wx, wy, part, level, at, red, green, blue,
                )  # fmt: skip
            _baked(light, patches[p], is_flat, u, v, wx, wy, at, lr, lg, lb)
            for lane in range(LANES):
                shade[lane] = _ONE
            if floors[p] and shadows.shape[0] > 0:
                _darken(shade, ray, far, hit, p, to_map, shadows, x, y)
            shine = looks[p, 6]
            for lane in range(LANES):
                pixel = pixels[tile, lane]
                if hit[lane] != p or pixel < 0:
                    continue
                gloss = _ZERO
                if shine > _ZERO:
                    gloss = shine * _mirrored(ray, far, lane, frames[p], eyes[p], kinds[p], to_map, key)
                own = looks[p, 5]
                out[pixel, 0] = looks[p, 2] * red[lane] * (lr[lane] * shade[lane] + own) + gloss * lr[lane]
                out[pixel, 1] = looks[p, 3] * green[lane] * (lg[lane] * shade[lane] + own) + gloss * lg[lane]
                out[pixel, 2] = looks[p, 4] * blue[lane] * (lb[lane] * shade[lane] + own) + gloss * lb[lane]


@_kernel
def _distinct(hit: npt.NDArray[Any], surfaces: npt.NDArray[Any]) -> int:
    """Write which surfaces the rays of a tile meet, each once, and return how many."""
    n = 0
    previous = _I(-2)
    for lane in range(LANES):
        p = hit[lane]
        if p == previous:
            continue
        previous = p
        is_new = True
        for k in range(n):
            is_new = is_new and surfaces[k] != p
        if is_new:
            surfaces[n] = p
            n += 1
    return n


@_inlined
def _place_flat(
    p: int,
    hit: npt.NDArray[Any],
    ray: npt.NDArray[Any],
    far: npt.NDArray[Any],
    m: npt.NDArray[Any],
    q: npt.NDArray[Any],
    pixel_rad: Any,
    u: npt.NDArray[Any],
    v: npt.NDArray[Any],
    foot: npt.NDArray[Any],
    ax: npt.NDArray[Any],
    ay: npt.NDArray[Any],
    bx: npt.NDArray[Any],
    by: npt.NDArray[Any],
) -> None:
    """Write where the rays meet a rectangle, and the two sides of each pixel's footprint there, as shares of u and v.

    `foot` receives the texel size that the four places call for [m].
    """
    n1 = math.sqrt(m[1, 0] * m[1, 0] + m[1, 1] * m[1, 1] + m[1, 2] * m[1, 2])
    n2 = math.sqrt(m[2, 0] * m[2, 0] + m[2, 1] * m[2, 1] + m[2, 2] * m[2, 2])
    per_1, per_2 = _ONE / n1, _ONE / n2
    for lane in range(LANES):
        dx, dy, dz = ray[0, lane], ray[1, lane], ray[2, lane]
        t = far[lane] if hit[lane] == p else _ZERO
        m0 = m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz
        m1 = m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz
        m2 = m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz
        u[lane], v[lane] = q[1] + t * m1, q[2] + t * m2
        short = t * pixel_rad
        # The footprint is longer the more the surface leans, along the ray's shadow on it.
        stretch = min(_EIGHT, _ONE / max(_F(0.02), abs(m0)))
        a, b = m1 * per_1, m2 * per_2
        length = math.sqrt(a * a + b * b)
        is_square = length < _F(1e-3)
        per_length = _ONE / max(_F(1e-3), length)
        a, b = _ONE if is_square else a * per_length, _ZERO if is_square else b * per_length
        long = short * stretch
        ax[lane], ay[lane] = a * n1 * long, b * n2 * long
        bx[lane], by[lane] = -b * n1 * short, a * n2 * short
        foot[lane] = short * max(_TEXEL_PX, stretch * _F(0.25))


@_kernel
def _place_round(
    p: int,
    hit: npt.NDArray[Any],
    ray: npt.NDArray[Any],
    far: npt.NDArray[Any],
    m: npt.NDArray[Any],
    q: npt.NDArray[Any],
    kind: int,
    pixel_rad: Any,
    density: Any,
    size: tuple[Any, Any],
    u: npt.NDArray[Any],
    v: npt.NDArray[Any],
    foot: npt.NDArray[Any],
    ax: npt.NDArray[Any],
    ay: npt.NDArray[Any],
    bx: npt.NDArray[Any],
    by: npt.NDArray[Any],
) -> None:
    """The same of a cylinder or an ellipsoid, whose footprints are taken as square."""
    for lane in range(LANES):
        u[lane], v[lane], foot[lane] = _ZERO, _ZERO, _ZERO
        ax[lane], ay[lane], bx[lane], by[lane] = _ZERO, _ZERO, _ZERO, _ZERO
        if hit[lane] != p:
            continue
        dx, dy, dz, t = ray[0, lane], ray[1, lane], ray[2, lane], far[lane]
        l0 = q[0] + t * (m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz)
        l1 = q[1] + t * (m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz)
        l2 = q[2] + t * (m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz)
        u[lane] = math.atan2(l2, l1) * _TURN + _HALF
        v[lane] = l0 if kind == CYLINDER else (l0 + _ONE) * _HALF
        short = t * pixel_rad
        ax[lane], by[lane] = short * density / size[0], short * density / size[1]
        foot[lane] = short * _TEXEL_PX


@_kernel
def _plain(texel: Any, red: npt.NDArray[Any], green: npt.NDArray[Any], blue: npt.NDArray[Any]) -> None:
    per = _F(1.0 / (255.0 * 255.0))
    r, g, b = _F(texel & 255), _F((texel >> 8) & 255), _F((texel >> 16) & 255)
    for lane in range(LANES):
        red[lane], green[lane], blue[lane] = r * r * per, g * g * per, b * b * per


@_inlined
def _textured(
    texels: npt.NDArray[Any],
    starts: npt.NDArray[Any],
    size: npt.NDArray[Any],
    look: npt.NDArray[Any],
    u: npt.NDArray[Any],
    v: npt.NDArray[Any],
    foot: npt.NDArray[Any],
    ax: npt.NDArray[Any],
    ay: npt.NDArray[Any],
    bx: npt.NDArray[Any],
    by: npt.NDArray[Any],
    x: npt.NDArray[Any],
    y: npt.NDArray[Any],
    wx: npt.NDArray[Any],
    wy: npt.NDArray[Any],
    part: npt.NDArray[Any],
    level: npt.NDArray[Any],
    at: tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]],
    red: npt.NDArray[Any],
    green: npt.NDArray[Any],
    blue: npt.NDArray[Any],
) -> None:
    """Write the reflectance under each pixel: means of four places of its footprint, on two levels of the mip-map."""
    width, height, top = _I(size[0]), _I(size[1]), _I(size[2] - 1)
    across, up = look[0] * _F(width), look[1] * _F(height)
    needs_fine, needs_coarse, largest = _I(0), _I(0), _ZERO
    for lane in range(LANES):
        texels_wide = foot[lane] * look[7]
        largest = max(largest, texels_wide)
        # The exponent of a float is its logarithm, the rest of its bits nearly the fraction: ten times as fast as log2.
        bits = _F(max(texels_wide, _ONE)).view(np.int32)
        rest = _F(bits & _I(0x7FFFFF)) * _PER_MANTISSA
        low = (bits >> _I(23)) - _I(127)
        level[lane] = min(low, top)
        # Most pixels need one level only; between two the change is quick but not sudden.
        share = _ZERO if low >= top else min(_ONE, max(_ZERO, rest * _F(3.0) - _ONE))
        part[lane] = share
        needs_fine |= _I(1) if share < _ONE else _I(0)
        needs_coarse |= _I(1) if share > _ZERO else _I(0)
        red[lane], green[lane], blue[lane] = _ZERO, _ZERO, _ZERO
    n_taps = 1 if largest * _LARGE < _ONE else _N_TAPS
    scale = _PER_TAP * _F(_N_TAPS // n_taps)
    for tap in range(n_taps):
        along, aside = (_ALONG[tap], _ACROSS[tap]) if n_taps > 1 else (_ZERO, _ZERO)
        for lane in range(LANES):
            x[lane] = (u[lane] + along * ax[lane] + aside * bx[lane]) * across
            y[lane] = (_ONE - (v[lane] + along * ay[lane] + aside * by[lane])) * up
        if needs_fine:
            _find(starts, width, height, level, _I(0), x, y, wx, wy, at)
            _gather(texels, at, wx, wy, part, -scale, scale, red, green, blue)
        if needs_coarse:
            _find(starts, width, height, level, _I(1), x, y, wx, wy, at)
            _gather(texels, at, wx, wy, part, scale, _ZERO, red, green, blue)


@_inlined
def _find(
    starts: npt.NDArray[Any],
    width: Any,
    height: Any,
    level: npt.NDArray[Any],
    above: Any,
    x: npt.NDArray[Any],
    y: npt.NDArray[Any],
    wx: npt.NDArray[Any],
    wy: npt.NDArray[Any],
    at: tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]],
) -> None:
    """Write which four texels lie about each place on a level of the mip-map, and the place between them."""
    a, b, c, d = at
    one = _I(1)
    most = _I(starts.shape[0] - 1)
    for lane in range(LANES):
        k = min(level[lane] + above, most)
        scale = _I((127 - k) << 23).view(np.float32)  # a power of two is its exponent
        px, py = x[lane] * scale - _HALF, y[lane] * scale - _HALF
        fx, fy = math.floor(px), math.floor(py)
        wx[lane], wy[lane] = px - _F(fx), py - _F(fy)
        i, j = _I(fx), _I(fy)
        wide, high = max(one, width >> k), max(one, height >> k)
        i0, i1 = i & (wide - one), (i + one) & (wide - one)
        j0, j1 = (j & (high - one)) * wide, ((j + one) & (high - one)) * wide
        start = starts[k]
        a[lane], b[lane], c[lane], d[lane] = start + j0 + i0, start + j0 + i1, start + j1 + i0, start + j1 + i1


@_inlined
def _gather(
    texels: npt.NDArray[Any],
    at: tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]],
    wx: npt.NDArray[Any],
    wy: npt.NDArray[Any],
    part: npt.NDArray[Any],
    slope: Any,
    offset: Any,
    red: npt.NDArray[Any],
    green: npt.NDArray[Any],
    blue: npt.NDArray[Any],
) -> None:
    """Add the light of four texels about each place, times ``part * slope + offset``.

    Texels hold the root of their light. It is squared before it is averaged: light adds up, not its root, and an edge
    would move towards its dark side otherwise.
    """
    ia, ib, ic, id_ = at
    byte, s8, s16 = _I(255), _I(8), _I(16)
    for lane in range(LANES):
        ta, tb, tc, td = texels[ia[lane]], texels[ib[lane]], texels[ic[lane]], texels[id_[lane]]
        weight = part[lane] * slope + offset
        wd = wx[lane] * wy[lane]
        wb, wc = wx[lane] - wd, wy[lane] - wd
        wa = _ONE - wx[lane] - wc
        ra, rb, rc, rd = _F(ta & byte), _F(tb & byte), _F(tc & byte), _F(td & byte)
        ga, gb, gc, gd = _F((ta >> s8) & byte), _F((tb >> s8) & byte), _F((tc >> s8) & byte), _F((td >> s8) & byte)
        ba, bb, bc, bd = _F((ta >> s16) & byte), _F((tb >> s16) & byte), _F((tc >> s16) & byte), _F((td >> s16) & byte)
        red[lane] += weight * (wa * ra * ra + wb * rb * rb + wc * rc * rc + wd * rd * rd)
        green[lane] += weight * (wa * ga * ga + wb * gb * gb + wc * gc * gc + wd * gd * gd)
        blue[lane] += weight * (wa * ba * ba + wb * bb * bb + wc * bc * bc + wd * bd * bd)


@_inlined
def _baked(
    light: npt.NDArray[Any],
    patch: npt.NDArray[Any],
    is_flat: bool,
    u: npt.NDArray[Any],
    v: npt.NDArray[Any],
    wx: npt.NDArray[Any],
    wy: npt.NDArray[Any],
    at: tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]],
    lr: npt.NDArray[Any],
    lg: npt.NDArray[Any],
    lb: npt.NDArray[Any],
) -> None:
    """Write the baked light at each place, bilinear; around a round shape the columns close."""
    start, columns, rows = _I(patch[0]), _I(patch[1]), _I(patch[2])
    right, top = _F(columns - 1), _F(rows - 1)
    low = _ZERO if is_flat else -_ONE
    high = right if is_flat else _F(columns)
    a, b, c, d = at
    one, zero = _I(1), _I(0)
    for lane in range(LANES):
        x = min(high, max(low, u[lane] * _F(columns) - _HALF))
        y = min(top, max(_ZERO, v[lane] * _F(rows) - _HALF))
        fx, fy = math.floor(x), math.floor(y)
        wx[lane], wy[lane] = x - _F(fx), y - _F(fy)
        i, j = _I(fx), _I(fy)
        j1 = min(j + one, rows - one)
        i0 = i + columns if i < zero else i
        i0 = i0 - columns if i0 >= columns else i0
        i1 = i0 + one
        beyond = columns - one if is_flat else zero
        i1 = beyond if i1 >= columns else i1
        a[lane], b[lane] = start + j * columns + i0, start + j * columns + i1
        c[lane], d[lane] = start + j1 * columns + i0, start + j1 * columns + i1
    for lane in range(LANES):
        wd = wx[lane] * wy[lane]
        wb, wc = wx[lane] - wd, wy[lane] - wd
        wa = _ONE - wx[lane] - wc
        ka, kb, kc, kd = a[lane], b[lane], c[lane], d[lane]
        lr[lane] = wa * light[ka, 0] + wb * light[kb, 0] + wc * light[kc, 0] + wd * light[kd, 0]
        lg[lane] = wa * light[ka, 1] + wb * light[kb, 1] + wc * light[kc, 1] + wd * light[kd, 1]
        lb[lane] = wa * light[ka, 2] + wb * light[kb, 2] + wc * light[kc, 2] + wd * light[kd, 2]


@_kernel
def _darken(
    shade: npt.NDArray[Any],
    ray: npt.NDArray[Any],
    far: npt.NDArray[Any],
    hit: npt.NDArray[Any],
    p: int,
    to_map: npt.NDArray[Any],
    shadows: npt.NDArray[Any],
    x: npt.NDArray[Any],
    y: npt.NDArray[Any],
) -> None:
    """Write the share of the light that people leave on the floor."""
    for lane in range(LANES):
        t = far[lane] if hit[lane] == p else _ZERO
        dx, dy, dz = ray[0, lane], ray[1, lane], ray[2, lane]
        x[lane] = to_map[3, 0] + t * (to_map[0, 0] * dx + to_map[0, 1] * dy + to_map[0, 2] * dz)
        y[lane] = to_map[3, 1] + t * (to_map[1, 0] * dx + to_map[1, 1] * dy + to_map[1, 2] * dz)
    for k in range(shadows.shape[0]):
        sx, sy, per, depth = shadows[k, 0], shadows[k, 1], _ONE / (shadows[k, 2] * shadows[k, 2]), shadows[k, 3]
        for lane in range(LANES):
            kx, ky = x[lane] - sx, y[lane] - sy
            near = max(_ZERO, _ONE - (kx * kx + ky * ky) * per)
            shade[lane] *= _ONE - depth * near * near


@_kernel
def _mirrored(
    ray: npt.NDArray[Any],
    far: npt.NDArray[Any],
    lane: int,
    m: npt.NDArray[Any],
    q: npt.NDArray[Any],
    kind: int,
    to_map: npt.NDArray[Any],
    key: npt.NDArray[Any],
) -> Any:
    """Return what a shiny surface mirrors: a bright spot where the key light is, a paler ceiling or sky."""
    dx, dy, dz, t = ray[0, lane], ray[1, lane], ray[2, lane], far[lane]
    w0, w1, w2 = _ONE, _ZERO, _ZERO
    if kind != RECTANGLE:
        w0 = _ZERO if kind == CYLINDER else q[0] + t * (m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz)
        w1 = q[1] + t * (m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz)
        w2 = q[2] + t * (m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz)
    nx = w0 * m[0, 0] + w1 * m[1, 0] + w2 * m[2, 0]
    ny = w0 * m[0, 1] + w1 * m[1, 1] + w2 * m[2, 1]
    nz = w0 * m[0, 2] + w1 * m[1, 2] + w2 * m[2, 2]
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
def _sky_lanes(
    out: npt.NDArray[Any],
    pixels: npt.NDArray[Any],
    hit: npt.NDArray[Any],
    ray: npt.NDArray[Any],
    to_map: npt.NDArray[Any],
    sky: npt.NDArray[Any],
) -> None:
    """Read the sky off its picture, bilinear, for the rays that meet nothing."""
    rows, columns = sky.shape[0], sky.shape[1]
    for lane in range(LANES):
        pixel = pixels[lane]
        if hit[lane] >= 0 or pixel < 0:
            continue
        dx, dy, dz = ray[0, lane], ray[1, lane], ray[2, lane]
        x = to_map[0, 0] * dx + to_map[0, 1] * dy + to_map[0, 2] * dz
        y = to_map[1, 0] * dx + to_map[1, 1] * dy + to_map[1, 2] * dz
        z = to_map[2, 0] * dx + to_map[2, 1] * dy + to_map[2, 2] * dz
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
