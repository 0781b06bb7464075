"""What colour a surface has under each pixel: its texture, on the levels of the mip-map that fit the footprint."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.kernels import inlined_kernel, kernel
from trailmark_sim.render.lanes import Colours, Footprints, Taps
from trailmark_sim.render.rays import LANES

__all__ = ["plain", "read_texture"]

_F: Any = np.float32
_I: Any = np.int32
_ZERO, _HALF, _ONE = _F(0.0), _F(0.5), _F(1.0)
_PER_MANTISSA = _F(1.0 / (1 << 23))
#: Four places of a pixel's footprint, none above or beside another: each axis sees four places a quarter apart.
_N_TAPS = 4
_ALONG = np.array([-0.375, -0.125, 0.125, 0.375], np.float32)
_ACROSS = np.array([0.125, -0.375, 0.375, -0.125], np.float32)
_PER_TAP = _F(1.0 / (255.0 * 255.0 * _N_TAPS))
#: With texels larger than so many footprints one place in the middle does.
_LARGE = _F(4.0)


@kernel(error_model="numpy")
def plain(texel: Any, colours: Colours) -> None:
    """Write the reflectance of a surface of one colour."""
    red, green, blue = colours
    per = _F(1.0 / (255.0 * 255.0))
    r, g, b = _F(texel & 255), _F((texel >> 8) & 255), _F((texel >> 16) & 255)
    for lane in range(LANES):
        red[lane], green[lane], blue[lane] = r * r * per, g * g * per, b * b * per


@inlined_kernel
def read_texture(
    texels: AnyArray,
    starts: AnyArray,
    size: Any,
    surface: Any,
    place: Footprints,
    taps: Taps,
    part: AnyArray,
    level: AnyArray,
    colours: Colours,
) -> None:
    """Write the reflectance under each pixel: means of four places of its footprint, on two levels of the mip-map."""
    u, v, foot_m, ax, ay, bx, by = place
    x, y = taps.x, taps.y
    red, green, blue = colours
    width, height, top = _I(size.width), _I(size.height), _I(size.n_levels - 1)
    across, up = surface.repeat_u * _F(width), surface.repeat_v * _F(height)
    texels_per_m = surface.texels_per_m
    needs_fine, needs_coarse, largest = _I(0), _I(0), _ZERO
    for lane in range(LANES):
        texels_wide = foot_m[lane] * texels_per_m
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
        for above in range(2):
            if (needs_coarse if above else needs_fine) == 0:
                continue
            weighting = (scale, _ZERO) if above else (-scale, scale)
            _find(starts, (width, height), level, _I(above), taps)
            _gather(texels, taps, part, weighting, colours)


@inlined_kernel
def _find(starts: AnyArray, size: tuple[Any, Any], level: AnyArray, above: Any, taps: Taps) -> None:
    """Write which four texels lie about each place on a level of the mip-map, and the place between them."""
    x, y, wx, wy, a, b, c, d = taps
    width, height = size
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


@inlined_kernel
def _gather(texels: AnyArray, taps: Taps, part: AnyArray, weighting: tuple[Any, Any], colours: Colours) -> None:
    """Add the light of four texels about each place, times ``part * slope + offset`` with the `weighting`.

    Texels hold the root of their light. It is squared before it is averaged: light adds up, not its root, and an edge
    would move towards its dark side otherwise.
    """
    _, _, wx, wy, ia, ib, ic, id_ = taps
    red, green, blue = colours
    slope, offset = weighting
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
