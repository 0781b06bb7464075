"""What colour a surface has under each pixel: its texture, on the levels of the mip-map that fit the footprint."""

from __future__ import annotations

from typing import Any

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.kernels import inlined_kernel, kernel
from trailmark_sim.render.lanes import Colours, Footprints, Taps

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
def plain(texel: Any, n: int, colours: Colours) -> None:
    """Write the reflectance of a surface of one colour."""
    red, green, blue = colours
    per = _F(1.0 / (255.0 * 255.0))
    r, g, b = _F(texel & 255), _F((texel >> 8) & 255), _F((texel >> 16) & 255)
    for lane in range(n):
        red[lane], green[lane], blue[lane] = r * r * per, g * g * per, b * b * per


@inlined_kernel
def read_texture(
    texels: AnyArray,
    starts: AnyArray,
    size: Any,
    surface: Any,
    n: int,
    place: Footprints,
    taps: Taps,
    part: AnyArray,
    level: AnyArray,
    colours: Colours,
) -> None:
    """Write the reflectance under `n` pixels: means of four places of its footprint, on two levels of the mip-map."""
    u, v, foot_m, ax, ay, bx, by = place
    x, y = taps.x, taps.y
    red, green, blue = colours
    width, height, top = _I(size.width), _I(size.height), _I(size.n_levels - 1)
    across, up = surface.repeat_u * _F(width), surface.repeat_v * _F(height)
    texels_per_m = surface.texels_per_m
    needs_fine, needs_coarse, is_wide = _I(0), _I(0), _I(0)
    for lane in range(n):
        texels_wide = foot_m[lane] * texels_per_m
        is_wide |= _I(0) if texels_wide * _LARGE < _ONE else _I(1)
        # The exponent of a float is its logarithm, the rest of its bits nearly the fraction: ten times as fast as log2.
        bits = _F(max(texels_wide, _ONE)).view(np.int32)
        rest = _F(_I(bits & _I(0x7FFFFF))) * _PER_MANTISSA
        low = _I(_I(bits >> _I(23)) - _I(127))
        level[lane] = _I(min(low, top))
        # Most pixels need one level only; between two the change is quick but not sudden.
        share = _ZERO if low >= top else min(_ONE, max(_ZERO, rest * _F(3.0) - _ONE))
        part[lane] = share
        needs_fine |= _I(1) if share < _ONE else _I(0)
        needs_coarse |= _I(1) if share > _ZERO else _I(0)
        red[lane], green[lane], blue[lane] = _ZERO, _ZERO, _ZERO
    n_taps = _N_TAPS if is_wide else 1
    scale = _PER_TAP * _F(_N_TAPS // n_taps)
    for tap in range(n_taps):
        along, aside = (_ALONG[tap], _ACROSS[tap]) if n_taps > 1 else (_ZERO, _ZERO)
        for lane in range(n):
            x[lane] = (u[lane] + along * ax[lane] + aside * bx[lane]) * across
            y[lane] = (_ONE - (v[lane] + along * ay[lane] + aside * by[lane])) * up
        for above in range(2):
            if (needs_coarse if above else needs_fine) == 0:
                continue
            weighting = (scale, _ZERO) if above else (-scale, scale)
            _find(starts, (width, height), level, _I(above), n, taps)
            _gather(texels, taps, part, weighting, n, colours)


@inlined_kernel
def _find(starts: AnyArray, size: tuple[Any, Any], level: AnyArray, above: Any, n: int, taps: Taps) -> None:
    """Write which four texels lie about each place on a level of the mip-map, and the place between them."""
    x, y, wx, wy, a, b, c, d = taps
    width, height = _F(size[0]), _F(size[1])
    one = _I(1)
    most = _I(starts.shape[0] - 1)
    for lane in range(n):
        k = _I(min(_I(level[lane] + above), most))
        scale = _I(_I(_I(127) - k) << _I(23)).view(np.float32)  # a power of two is its exponent
        px, py = x[lane] * scale - _HALF, y[lane] * scale - _HALF
        fx, fy = np.floor(px), np.floor(py)
        wx[lane], wy[lane] = px - fx, py - fy
        i, j = _I(fx), _I(fy)
        wide, high = _I(max(_ONE, width * scale)), _I(max(_ONE, height * scale))
        last_i, last_j = _I(wide - one), _I(high - one)
        i0, i1 = _I(i & last_i), _I(_I(i + one) & last_i)
        start = starts[np.uint64(k)]
        j0, j1 = _I(start + _I(_I(j & last_j) * wide)), _I(start + _I(_I(_I(j + one) & last_j) * wide))
        a[lane], b[lane], c[lane], d[lane] = _I(j0 + i0), _I(j0 + i1), _I(j1 + i0), _I(j1 + i1)


@inlined_kernel
def _gather(texels: AnyArray, taps: Taps, part: AnyArray, weighting: tuple[Any, Any], n: int, colours: Colours) -> None:
    """Add the light of four texels about each place, times ``part * slope + offset`` with the `weighting`.

    Texels hold the root of their light. It is squared before it is averaged: light adds up, not its root, and an edge
    would move towards its dark side otherwise.
    """
    _, _, wx, wy, ia, ib, ic, id_ = taps
    red, green, blue = colours
    slope, offset = weighting
    byte = _I(255)
    for lane in range(n):
        ka, kb, kc, kd = np.uint64(ia[lane]), np.uint64(ib[lane]), np.uint64(ic[lane]), np.uint64(id_[lane])
        ta, tb, tc, td = texels[ka], texels[kb], texels[kc], texels[kd]
        weight = part[lane] * slope + offset
        wd = wx[lane] * wy[lane]
        wb, wc = wx[lane] - wd, wy[lane] - wd
        wa = _ONE - wx[lane] - wc
        ra, rb, rc, rd = _F(_I(ta & byte)), _F(_I(tb & byte)), _F(_I(tc & byte)), _F(_I(td & byte))
        ga, gb, gc, gd = _second(ta), _second(tb), _second(tc), _second(td)
        ba, bb, bc, bd = _third(ta), _third(tb), _third(tc), _third(td)
        red[lane] += weight * (wa * ra * ra + wb * rb * rb + wc * rc * rc + wd * rd * rd)
        green[lane] += weight * (wa * ga * ga + wb * gb * gb + wc * gc * gc + wd * gd * gd)
        blue[lane] += weight * (wa * ba * ba + wb * bb * bb + wc * bc * bc + wd * bd * bd)


@inlined_kernel
def _second(texel: Any) -> Any:
    return _F(_I(_I(texel >> _I(8)) & _I(255)))


@inlined_kernel
def _third(texel: Any) -> Any:
    return _F(_I(_I(texel >> _I(16)) & _I(255)))
