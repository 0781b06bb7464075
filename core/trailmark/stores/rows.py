"""Arrays as one blob with a layout, and the checksum that every row carries."""

from __future__ import annotations

import json
import math
import struct
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.errors import ShapeError
from trailmark.frames.array_documents import ARRAY_DTYPES, array_from_bytes, array_to_bytes

__all__ = ["MAX_BYTES", "check_name", "checksum", "pack_arrays", "unpack_arrays"]

Value = int | float | str | bytes | None

#: The most that one keyframe or one saved set of arrays may hold: SQLite takes no larger row.
MAX_BYTES = 900_000_000
_MAX_ARRAYS = 10_000
_MAX_NAME = 200


def checksum(table: str, *values: Value) -> int:
    """Return the CRC-32 of a row: the name of its table and its values, each with its type and length.

    The table's name is part of it, so that a row which a damaged page puts elsewhere does not pass.
    """
    crc = zlib.crc32(table.encode())
    for value in values:
        if isinstance(value, float):
            kind, raw = b"f", struct.pack("<d", value)
        elif isinstance(value, bytes):
            kind, raw = b"b", value
        else:
            kind, raw = type(value).__name__[:1].encode(), str(value).encode("utf-8", "surrogatepass")
        crc = zlib.crc32(raw, zlib.crc32(b"%s%d:" % (kind, len(raw)), crc))
    return crc


def pack_arrays(arrays: Mapping[str, npt.NDArray[Any]]) -> tuple[str, bytes]:
    """Return named arrays as a layout and the bytes of all of them, one after the other.

    Returns
    -------
    layout : str
        JSON: ``[[name, dtype, [length, ...]], ...]``.
    data : bytes
        Elements in C order, little-endian.

    Raises
    ------
    ShapeError
        If a name or dtype cannot be stored, or it is too much for one row.
    """
    if len(arrays) > _MAX_ARRAYS or sum(array.nbytes for array in arrays.values()) > MAX_BYTES:
        raise ShapeError(
            f"{len(arrays)} arrays of together {sum(array.nbytes for array in arrays.values())} bytes are too much for"
            f" one row; {_MAX_ARRAYS} arrays and {MAX_BYTES} bytes are the most"
        )
    layout: list[tuple[str, str, list[int]]] = []
    parts: list[bytes] = []
    for name, array in arrays.items():
        check_name(name, "an array")
        try:
            parts.append(array_to_bytes(array))
        except ShapeError as error:
            raise ShapeError(f"array {name!r}: {error}") from error
        layout.append((name, array.dtype.name, list(array.shape)))
    return json.dumps(layout, separators=(",", ":")), b"".join(parts)


def unpack_arrays(layout: str, data: bytes) -> dict[str, npt.NDArray[Any]]:
    """Return the named arrays of `pack_arrays`, read-only; nothing is allocated beyond the bytes that are there.

    Raises
    ------
    ValueError
        If the layout is no such list, or does not fit the bytes.
    """
    try:
        entries = json.loads(layout)
    except RecursionError:
        raise ValueError("the layout is nested too deep") from None
    if not isinstance(entries, list) or len(entries) > _MAX_ARRAYS:
        raise ValueError("the layout is not a list of arrays")
    arrays: dict[str, npt.NDArray[Any]] = {}
    start = 0
    for entry in entries:
        name, dtype_name, shape = _entry(entry)
        if name in arrays:
            raise ValueError(f"the layout has {name!r} twice")
        n_bytes = math.prod(shape) * ARRAY_DTYPES[dtype_name].itemsize
        arrays[name] = array_from_bytes(data[start : start + n_bytes], dtype_name, shape)
        start += n_bytes
    if start != len(data):
        raise ValueError(f"the layout speaks of {start} bytes, but there are {len(data)}")
    return arrays


def check_name(name: object, what: str) -> None:
    """Raise `ShapeError` unless a name is printable text of a sensible length."""
    if not isinstance(name, str) or not name.isprintable() or not 0 < len(name) <= _MAX_NAME:
        raise ShapeError(f"{what} cannot be named {str(name)[:40]!r}: use 1 to {_MAX_NAME} printable characters")


def _entry(entry: Any) -> tuple[str, str, list[int]]:
    is_entry = isinstance(entry, list) and len(entry) == 3 and isinstance(entry[0], str) and isinstance(entry[1], str)
    if not is_entry or entry[1] not in ARRAY_DTYPES or not isinstance(entry[2], list):
        raise ValueError("the layout has an entry that is no array")
    if any(type(length) is not int or not 0 <= length <= np.iinfo(np.intp).max for length in entry[2]):
        raise ValueError("the layout has a shape that is none")
    return entry[0], entry[1], entry[2]
