"""The kernels that a first picture needs and that take long to compile, for two processes that share the work.

A process that has no second one beside it compiles each when it is called.
"""

from __future__ import annotations

from typing import Any

import numba

from trailmark_ground_vo import (
    absolute,
    audit,
    consensus,
    extremes,
    filters,
    grain,
    refine,
    search,
    shared_texture,
    texture,
    uncertainty,
    weak_axis,
)

__all__ = ["FIRST_KERNELS"]

types: Any = numba.types  # which has no types of its own

_GREY8, _GREY16 = types.uint8[:, ::1], types.uint16[:, ::1]
_TEXTURE, _MASK, _SUMS, _ERRORS = (
    types.float32[:, ::1],
    types.boolean[:, ::1],
    types.float64[:, ::1],
    types.int32[:, :, ::1],
)
_FLOAT, _INT = types.float64, types.int64
_POINT, _POSE, _AREA = types.UniTuple(_FLOAT, 2), types.UniTuple(_FLOAT, 3), types.UniTuple(_INT, 4)
_NUMBERS, _INDICES = _FLOAT[::1], _INT[::1]
_PIXELS = (_NUMBERS, _NUMBERS, types.uint8[::1], types.boolean[::1])
_PARTS = types.Tuple((_TEXTURE, _INDICES, _MASK))

#: A kernel, of the searches those of the usual ranges, and the types of its arguments; first what takes longest.
FIRST_KERNELS: tuple[tuple[Any, tuple[Any, ...]], ...] = (
    (refine.refine, (_GREY16, _TEXTURE, _POINT, _POSE, _FLOAT, _FLOAT, _INT)),
    (
        texture.advance_texture,
        (_GREY16, _TEXTURE, types.float32[::1], _AREA, _INT, _POINT, _POSE, _FLOAT, _FLOAT, _FLOAT, _FLOAT),
    ),
    (consensus._decide, (_SUMS,)),
    (search.sad_search(8), (_GREY8, _GREY8, _INT[:, :, ::1], types.uint8[::1])),
    (extremes.advance, (_GREY8, *_PIXELS, _AREA, _POINT, _POSE, _FLOAT, _FLOAT)),
    (refine.best_start, (_GREY16, _TEXTURE, _POINT, _SUMS, _FLOAT, _FLOAT)),
    (texture.select_texture, (_GREY16, _AREA, _INT, _INT)),
    (audit._samples, (_GREY16, _GREY16, _TEXTURE, _POINT, _POSE, _FLOAT)),
    (absolute.patch_search(32), (types.int8[:, ::1], types.int8[:, ::1], _INT[:, :, :, ::1], types.int8[:, ::1])),
    (audit._decide, (_SUMS, _SUMS, _FLOAT, _POINT)),
    (audit._equations, (_TEXTURE, _INDICES, _FLOAT)),
    (shared_texture._sums_of_parts, (_GREY16, _GREY16, _MASK, _POSE, _FLOAT, types.UniTuple(_INT, 2))),
    (extremes.select, (_GREY8, _AREA, _INT)),
    (search.summarise, (_ERRORS, _ERRORS)),
    (filters.smooth, (_GREY8,)),
    (grain._slope_products, (_GREY16, _GREY16, _MASK, _POSE, _FLOAT)),
    (grain._sums_along, (_TEXTURE, _TEXTURE, _TEXTURE, _TEXTURE)),
    (weak_axis._sums_of_parts, (_GREY16, _GREY16, _PARTS, _POINT, _POSE, _FLOAT, _FLOAT)),
    (texture.residuals, (_GREY16, _TEXTURE, _POINT, _POSE, _FLOAT)),
    (refine.mean_slopes, (_GREY16, _TEXTURE, _POINT, _POSE, _FLOAT)),
    (uncertainty.response_covariance, (_ERRORS, _INT, _INT)),
    (filters.transpose, (_GREY8,)),
    (filters.cell_means, (_GREY8, _INT)),
    (absolute.group_places, (_SUMS, _SUMS, _POINT, _NUMBERS, _FLOAT, _AREA)),
)
