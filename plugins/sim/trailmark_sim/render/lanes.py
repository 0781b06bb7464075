"""Scratch memory for the kernels: one number for each ray of a tile, on the stack.

The compiler knows that nothing else points there. Only so can it do eight or sixteen rays at once in loops that read
textures at places it cannot foresee.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import carray  # type: ignore[attr-defined]
from numba import types as numba_types
from numba.core import cgutils as numba_cgutils
from numba.extending import intrinsic

from trailmark.arrays import AnyArray
from trailmark.kernels import inlined_kernel, kernel
from trailmark_sim.render.rays import LANES

__all__ = ["Colours", "Footprints", "Taps", "distinct_shapes", "floats", "ints"]

types: Any = numba_types
cgutils: Any = numba_cgutils
_SHAPE = (LANES,)


class Footprints(NamedTuple):
    """What each pixel of a tile covers of a surface, (64,) float32 each.

    Its middle (u, v) and the two sides of its footprint, (ax, ay) and (bx, by), all as shares of the surface's u and v;
    `foot_m` is the texel size that the four places in it call for [m].
    """

    u: AnyArray
    v: AnyArray
    foot_m: AnyArray
    ax: AnyArray
    ay: AnyArray
    bx: AnyArray
    by: AnyArray


class Taps(NamedTuple):
    """Places read from a picture, (64,) each: four neighbours `a` to `d` (int32) and the place between them."""

    x: AnyArray
    y: AnyArray
    wx: AnyArray
    wy: AnyArray
    a: AnyArray
    b: AnyArray
    c: AnyArray
    d: AnyArray


class Colours(NamedTuple):
    """Red, green and blue of each ray of a tile, (64,) float32 each.

    Attributes
    ----------
    red, green, blue : array
        Linear light, (64,) float32.
    """

    red: AnyArray
    green: AnyArray
    blue: AnyArray


def _stack_array(context: Any, builder: Any, kind: Any) -> Any:
    memory = cgutils.alloca_once(builder, ir.ArrayType(context.get_value_type(kind), LANES))
    return builder.bitcast(memory, context.get_value_type(kind).as_pointer())


@intrinsic
def _float_lanes(typingctx: Any = None) -> Any:
    """Return a pointer to 64 float32 that live as long as the calling kernel."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _stack_array(context, builder, types.float32)

    return types.CPointer(types.float32)(), codegen


@intrinsic
def _int_lanes(typingctx: Any = None) -> Any:
    """Return a pointer to 64 int32 that live as long as the calling kernel."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _stack_array(context, builder, types.int32)

    return types.CPointer(types.int32)(), codegen


@inlined_kernel
def floats() -> Any:
    """Return 64 float32 that live as long as the calling kernel."""
    return carray(_float_lanes(), _SHAPE)


@inlined_kernel
def ints() -> Any:
    """Return 64 int32 that live as long as the calling kernel."""
    return carray(_int_lanes(), _SHAPE)


@kernel
def distinct_shapes(hit: AnyArray, found: AnyArray) -> int:
    """Write which shapes the rays of a tile meet, each once, and return how many."""
    n = 0
    previous = np.int32(-2)
    for lane in range(LANES):
        p = hit[lane]
        if p == previous:
            continue
        previous = p
        is_new = True
        for k in range(n):
            is_new = is_new and found[k] != p
        if is_new:
            found[n] = p
            n += 1
    return n
