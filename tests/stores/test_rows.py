"""Packing arrays, and the checksums of rows."""

from __future__ import annotations

import json
import struct
import zlib
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from trailmark.errors import ShapeError
from trailmark.frames.array_documents import ARRAY_DTYPES
from trailmark.stores import tables
from trailmark.stores.rows import checksum, pack_arrays, unpack_arrays

any_array = st.sampled_from(list(ARRAY_DTYPES)).flatmap(
    lambda name: hnp.arrays(np.dtype(name), hnp.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=5))
)
names = st.text(st.characters(exclude_categories=("C", "Z")), min_size=1, max_size=20).filter(str.isprintable)


@given(st.dictionaries(names, any_array, max_size=4))
def test_arrays_come_back_with_every_bit(arrays: dict[str, npt.NDArray[Any]]) -> None:
    back = unpack_arrays(*pack_arrays(arrays))

    assert list(back) == list(arrays)
    for name, array in arrays.items():
        assert (back[name].dtype, back[name].shape) == (array.dtype, array.shape)
        assert back[name].tobytes() == array.tobytes()


def test_the_layout_says_in_plain_text_what_the_bytes_are() -> None:
    arrays = {"patch": np.arange(6, dtype=np.uint8).reshape(2, 3), "x": np.array([1.0], dtype=">f8")}

    layout, data = pack_arrays(arrays)

    assert layout == '[["patch","uint8",[2,3]],["x","float64",[1]]]'
    assert data == bytes(range(6)) + b"\x00\x00\x00\x00\x00\x00\xf0\x3f"


def test_arrays_that_are_views_are_packed_in_their_own_order() -> None:
    array = np.arange(24, dtype=np.int16).reshape(4, 6)[::2, ::-1].T

    back = unpack_arrays(*pack_arrays({"a": array}))["a"]

    np.testing.assert_array_equal(back, array)


def test_what_is_read_cannot_be_written() -> None:
    back = unpack_arrays(*pack_arrays({"a": np.zeros(3), "empty": np.zeros((0, 3))}))

    assert not any(array.flags.writeable for array in back.values())


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.array([{}]), "array 'a': an array of object cannot be stored"),
        (np.array(["text"]), "cannot be stored"),
        (np.array([1j]), "cannot be stored"),
        (np.zeros((1,) * 17), "17 dimensions"),
        (np.broadcast_to(np.uint8(0), (1000, 1000, 1000)), "are too much for one row"),
    ],
)
def test_what_cannot_be_kept_is_refused(array: npt.NDArray[Any], message: str) -> None:
    with pytest.raises(ShapeError, match=message):
        pack_arrays({"a": array})


@pytest.mark.parametrize("name", ["", "a\nb", "a\0", "x" * 201, "\ud800"])
def test_names_are_printable_and_short(name: str) -> None:
    with pytest.raises(ShapeError, match="cannot be named"):
        pack_arrays({name: np.zeros(1)})


@pytest.mark.parametrize(
    "layout",
    [
        "",
        "{}",
        "[" * 100_000,
        "[3]",
        '[["a"]]',
        '[["a","object",[1]]]',
        '[["a","uint8",1]]',
        '[["a","uint8",[-4]]]',
        '[["a","uint8",[4.0]]]',
        '[["a","uint8",[true]]]',
        '[["a","uint8",[5]]]',
        '[["a","uint8",[3]]]',
        '[["a","float64",[1]]]',
        '[["a","uint8",[2]],["a","uint8",[2]]]',
        '[["a","uint8",[4]],["b","uint8",[99999999999999999999]]]',
        '[["a","uint8",[4611686018427387904,4611686018427387904]]]',
        '[["a","uint8",[4]],["b","uint8",[4611686018427387904,4611686018427387904,0]]]',
        json.dumps([["a", "uint8", [1] * 40]]),
        '[["a","bool",[4]]]',
    ],
)
def test_a_hostile_layout_is_refused_and_allocates_nothing(layout: str) -> None:
    with pytest.raises(ValueError, match=r"layout|shape|Expecting|truth"):
        unpack_arrays(layout, b"\x01\x02\x03\x04")


def test_the_checksum_of_a_row_is_fixed_forever() -> None:
    raw = b"saved" + b"i1:3" + b"f8:" + struct.pack("<d", 0.15) + b"s3:\xc3\xa4x" + b"b2:\x00\xff"

    assert checksum("saved", 3, 0.15, "äx", b"\x00\xff") == zlib.crc32(raw)
    assert checksum("waypoints", 3, 0.15, -1.0, 2.5, 0.0) == 412_040_229


@pytest.mark.parametrize(
    ("left", "right"),
    [
        (("t", 1), ("t", 1.0)),
        (("t", "1"), ("t", 1)),
        (("t", b"1"), ("t", "1")),
        (("t", "ab", "c"), ("t", "a", "bc")),
        (("t", 1, 2), ("t", 2, 1)),
        (("t", None), ("t", "None")),
        (("t", 1), ("u", 1)),
    ],
)
def test_rows_that_differ_in_type_order_or_table_have_other_checksums(left: Any, right: Any) -> None:
    assert checksum(*left) != checksum(*right)


@pytest.mark.parametrize("index", [0, 9, 10, 123456])
def test_the_quick_checksum_of_a_waypoint_is_that_of_any_row(index: int) -> None:
    numbers = (0.05 * index, -1.25e-3, float(index) ** 0.5, -0.0)

    assert tables._waypoint_checksum(index, *numbers) == checksum("waypoints", index, *numbers)
