"""Vector instructions for the kernels, written once for every processor.

Numba does not keep 8 and 16-bit arithmetic in vector registers, so that a plain loop reaches a tenth of what the
processor can do. The intrinsics here emit LLVM's generic vector code (no instruction of one maker), which LLVM turns
into AVX-512, AVX2, SSE or NEON. Each works on blocks of `LANES` pixels, at offsets counted in elements of its array.
Every kernel that uses them has a plain twin for where this fails.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba.core.cgutils
import numba.extending
import numba.np.arrayobj
from llvmlite import ir
from numba import types

__all__ = [
    "CHUNK",
    "LANES",
    "PAIRS",
    "add_pairs",
    "add_window",
    "padded_columns",
    "padded_rows",
    "smooth_across",
    "smooth_down",
    "transpose_block",
]

# numba says little of its types, and calls an intrinsic without the context that it is declared with
cgutils: Any = numba.core.cgutils
make_array: Any = numba.np.arrayobj.make_array


def intrinsic(function: Callable[..., Any]) -> Any:
    """Make a function callable from kernels that emits its own code; sizes that are constants arrive as such."""
    return numba.extending.intrinsic(prefer_literal=True)(function)


#: Pixels that one vector holds.
LANES = 16

#: Pairs of pixels of 7 bits whose absolute differences certainly fit into a sum of 16 bits: 258 * 254 < 2**16.
PAIRS = 258

#: Reference pixels whose absolute differences certainly fit into a sum of 16 bits: 256 * 255 < 2**16.
CHUNK = 256

_I8, _I16, _I32, _I64 = (ir.IntType(bits) for bits in (8, 16, 32, 64))
_BYTES = ir.VectorType(_I8, LANES)
_WORDS = ir.VectorType(_I16, LANES)
_LONGS = ir.VectorType(_I32, LANES)


def padded_columns(size: int) -> int:
    """Return the columns of a window of `size` x `size` that whole vectors cover."""
    return LANES * (size // LANES if size % LANES == 1 else -(-size // LANES))


def padded_rows(size: int) -> int:
    """Return the rows of the column left over, rounded up to whole vectors; 0 when there is none."""
    return LANES * -(-size // LANES) if size % LANES == 1 else 0


def _pointer(context: Any, builder: Any, kind: Any, array: Any, offset: Any = None) -> Any:
    data = make_array(kind)(context, builder, array).data
    return data if offset is None else builder.gep(data, [offset])


def _at(builder: Any, pointer: Any, index: int) -> Any:
    return builder.gep(pointer, [ir.Constant(_I64, index)])


def _load(builder: Any, pointer: Any, kind: Any) -> Any:
    return builder.load(builder.bitcast(pointer, kind.as_pointer()), align=1)


def _store(builder: Any, vector: Any, pointer: Any) -> None:
    builder.store(vector, builder.bitcast(pointer, vector.type.as_pointer()), align=1)


def _fill(kind: Any, value: int) -> Any:
    return ir.Constant(kind, [value] * kind.count)


def _splat(builder: Any, value: Any, lanes: int) -> Any:
    undefined = ir.Constant(ir.VectorType(value.type, lanes), ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(_I32, 0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(_I32, lanes), [0] * lanes))


def _absolute(builder: Any, vector: Any) -> Any:
    kind = vector.type
    name = f"llvm.abs.v{kind.count}i{kind.element.width}"
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind, [kind, ir.IntType(1)]), name)
    return builder.call(function, [vector, ir.Constant(ir.IntType(1), 0)])


class _Sums:
    """Sums of 16 bits in vectors that stay in registers while the pixels of a chunk go by."""

    def __init__(self, builder: Any, count: int) -> None:
        self._builder = builder
        self._totals = [cgutils.alloca_once(builder, _WORDS) for _ in range(count)]
        for total in self._totals:
            builder.store(_fill(_WORDS, 0), total)

    def add(self, index: int, pointer: Any, minus_value: Any) -> None:
        """Add ``|pixels - value|`` to one vector."""
        builder = self._builder
        pixels = builder.zext(_load(builder, pointer, _BYTES), _WORDS)
        # -value was loaded as it is: a widened value would let LLVM see |a - b| of bytes, one instruction more
        difference = _absolute(builder, builder.add(pixels, minus_value))
        builder.store(builder.add(builder.load(self._totals[index]), difference), self._totals[index])

    def flush(self, first: int, count: int, pointer: Any) -> None:
        """Add vectors to int32 in memory, one after the other."""
        builder = self._builder
        for i in range(count):
            target = _at(builder, pointer, LANES * i)
            sums = builder.zext(builder.load(self._totals[first + i]), _LONGS)
            _store(builder, builder.add(_load(builder, target, _LONGS), sums), target)


@intrinsic
def add_window(
    typing_context: Any,
    size: Any,
    image: Any,
    offsets: Any,
    image_t: Any,
    offsets_t: Any,
    minus_values: Any,
    start: Any,
    stop: Any,
    out: Any,
    out_t: Any,
) -> Any:
    """Add up absolute differences over a window of ``size`` x ``size`` candidate shifts (a constant).

    For the reference pixels from `start` to `stop` (at most `CHUNK`) it adds ``|value - image|`` of every shift to
    `out`, (size, padded columns) int32. When one column is left over after whole vectors it goes to `out_t`,
    (padded rows,) int32, read along the transposed picture. `offsets` are those of the window's first pixel,
    `offsets_t` of the first pixel of the column left over; `minus_values` are int16.
    """
    rows = size.literal_value
    across, down = padded_columns(rows) // LANES, padded_rows(rows) // LANES
    arguments_types = (size, image, offsets, image_t, offsets_t, minus_values, start, stop, out, out_t)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        def pointer(position: int) -> Any:
            return _pointer(context, builder, signature.args[position], arguments[position])

        image, offsets, image_t, offsets_t, minus_values = (pointer(i) for i in (1, 2, 3, 4, 5))
        stride = cgutils.unpack_tuple(builder, make_array(signature.args[1])(context, builder, arguments[1]).shape)[1]
        sums = _Sums(builder, rows * across + down)
        first, last, step = arguments[6], arguments[7], ir.Constant(_I64, 1)
        with cgutils.for_range_slice(builder, first, last, step, intp=_I64) as (n, _):
            value = _splat(builder, builder.load(builder.gep(minus_values, [n])), LANES)
            row = builder.gep(image, [builder.load(builder.gep(offsets, [n]))])
            for j in range(rows):
                for i in range(across):
                    sums.add(j * across + i, _at(builder, row, LANES * i), value)
                row = builder.gep(row, [stride])
            if down:
                column = builder.gep(image_t, [builder.load(builder.gep(offsets_t, [n]))])
                for j in range(down):
                    sums.add(rows * across + j, _at(builder, column, LANES * j), value)
        sums.flush(0, rows * across, pointer(8))
        sums.flush(rows * across, down, pointer(9))
        return context.get_dummy_value()

    return types.void(*arguments_types), generate


@intrinsic
def transpose_block(
    typing_context: Any, image: Any, offset: Any, stride: Any, out: Any, offset_out: Any, stride_out: Any
) -> Any:
    """Transpose a block of `LANES` x `LANES` bytes."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        source = _pointer(context, builder, signature.args[0], arguments[0], arguments[1])
        target = _pointer(context, builder, signature.args[3], arguments[3], arguments[4])
        rows = []
        for _ in range(LANES):
            rows.append(_load(builder, source, _BYTES))
            source = builder.gep(source, [arguments[2]])
        half = LANES // 2
        low, high = (
            ir.Constant(_LONGS, [first + i // 2 + LANES * (i % 2) for i in range(LANES)]) for first in (0, half)
        )
        for _ in range(4):  # interleaving row i with row i + 8, four times over, swaps rows and columns
            pairs = [(rows[i], rows[i + half]) for i in range(half)]
            rows = [builder.shuffle_vector(a, b, mask) for a, b in pairs for mask in (low, high)]
        for row in rows:
            _store(builder, row, target)
            target = builder.gep(target, [arguments[5]])
        return context.get_dummy_value()

    return types.void(image, offset, stride, out, offset_out, stride_out), generate


def _binomial(builder: Any, taps: list[Any]) -> Any:
    """Return a + 4 b + 6 c + 4 d + e."""
    outer = builder.add(taps[0], taps[4])
    inner = builder.shl(builder.add(builder.add(taps[1], taps[3]), taps[2]), _fill(_WORDS, 2))
    middle = builder.shl(taps[2], _fill(_WORDS, 1))
    return builder.add(builder.add(outer, inner), middle)


@intrinsic
def smooth_down(typing_context: Any, image: Any, rows: Any, offset: Any, out: Any, offset_out: Any) -> Any:
    """Write the binomial sum of five rows of bytes (`rows`, a tuple of five row offsets) as `LANES` uint16."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        source = _pointer(context, builder, signature.args[0], arguments[0], arguments[2])
        starts = cgutils.unpack_tuple(builder, arguments[1], 5)
        taps = [builder.zext(_load(builder, builder.gep(source, [row]), _BYTES), _WORDS) for row in starts]
        target = _pointer(context, builder, signature.args[3], arguments[3], arguments[4])
        _store(builder, _binomial(builder, taps), target)
        return context.get_dummy_value()

    return types.void(image, rows, offset, out, offset_out), generate


@intrinsic
def smooth_across(typing_context: Any, line: Any, offset: Any, out: Any, offset_out: Any) -> Any:
    """Write the binomial sums along a line of uint16, from `offset` - 2 on, as `LANES` uint16."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        source = _pointer(context, builder, signature.args[0], arguments[0], arguments[1])
        taps = [_load(builder, _at(builder, source, i), _WORDS) for i in range(-2, 3)]
        target = _pointer(context, builder, signature.args[2], arguments[2], arguments[3])
        _store(builder, _binomial(builder, taps), target)
        return context.get_dummy_value()

    return types.void(line, offset, out, offset_out), generate


@intrinsic
def add_pairs(
    typing_context: Any,
    rows: Any,
    columns: Any,
    image: Any,
    offset: Any,
    offsets: Any,
    values: Any,
    start: Any,
    stop: Any,
    out: Any,
    offset_out: Any,
) -> Any:
    """Add up absolute differences of pixels of 7 bits over ``rows`` x ``columns`` shifts (constants).

    Two differences of 7 bits fit into 8, so that pixels are taken in pairs and widened once for both. Pairs from
    `start` to `stop` (at most `PAIRS`) go by; `image` and `values` are int8 from 0 to 127, `columns` is a multiple of
    `LANES`, and `out` takes (rows, columns) int32 from `offset_out` on. `offset` is added to all offsets.
    """
    n_rows, n_columns = rows.literal_value, columns.literal_value
    per_row = n_columns // (2 * LANES) if n_columns % (2 * LANES) == 0 else 0
    lanes = 2 * LANES if per_row else LANES
    per_row = per_row or n_columns // LANES
    bytes_kind, words_kind = ir.VectorType(_I8, lanes), ir.VectorType(_I16, lanes // 2)
    arguments_types = (rows, columns, image, offset, offsets, values, start, stop, out, offset_out)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        def pointer(position: int, shift: Any = None) -> Any:
            return _pointer(context, builder, signature.args[position], arguments[position], shift)

        image, offsets, values = pointer(2, arguments[3]), pointer(4), pointer(5)
        stride = cgutils.unpack_tuple(builder, make_array(signature.args[2])(context, builder, arguments[2]).shape)[1]
        totals = [[cgutils.alloca_once(builder, words_kind) for _ in range(2)] for _ in range(n_rows * per_row)]
        for both in totals:
            for total in both:
                builder.store(_fill(words_kind, 0), total)
        one = ir.Constant(_I64, 1)
        with cgutils.for_range_slice(builder, arguments[6], arguments[7], one, intp=_I64) as (pair, _):
            pixels = []
            for n in (builder.shl(pair, one), builder.add(builder.shl(pair, one), one)):
                value = _splat(builder, builder.load(builder.gep(values, [n])), lanes)
                pixels.append((value, builder.gep(image, [builder.load(builder.gep(offsets, [n]))])))
            for j in range(n_rows):
                for i in range(per_row):
                    sums = [
                        _absolute(builder, builder.sub(value, _load(builder, _at(builder, row, lanes * i), bytes_kind)))
                        for value, row in pixels
                    ]
                    words = builder.bitcast(builder.add(*sums), words_kind)
                    even, odd = totals[j * per_row + i]
                    low, high = builder.and_(words, _fill(words_kind, 255)), builder.lshr(words, _fill(words_kind, 8))
                    builder.store(builder.add(builder.load(even), low), even)
                    builder.store(builder.add(builder.load(odd), high), odd)
                pixels = [(value, builder.gep(row, [stride])) for value, row in pixels]
        half = lanes // 2
        mask = ir.Constant(ir.VectorType(_I32, lanes), [i // 2 + half * (i % 2) for i in range(lanes)])
        target = pointer(8, arguments[9])
        for index, (even, odd) in enumerate(totals):
            merged = builder.shuffle_vector(builder.load(even), builder.load(odd), mask)
            place = _at(builder, target, lanes * index)
            wide = ir.VectorType(_I32, lanes)
            _store(builder, builder.add(_load(builder, place, wide), builder.zext(merged, wide)), place)
        return context.get_dummy_value()

    return types.void(*arguments_types), generate
