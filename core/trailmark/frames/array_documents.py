"""Arrays as bytes, as documents and as files; what a stranger wrote is checked before anything is allocated."""

from __future__ import annotations

import base64
import binascii
import math
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.errors import ConfigError, ShapeError
from trailmark.frames.png import check_png, is_png

__all__ = [
    "ARRAY_DTYPES",
    "array_from_bytes",
    "array_from_document",
    "array_to_bytes",
    "array_to_document",
    "in_words",
    "read_array",
]

#: Element types that a document or a path store may hold, by name; their bytes are little-endian.
ARRAY_DTYPES: dict[str, np.dtype[Any]] = {
    name: np.dtype(name).newbyteorder("<")
    for name in (
        *("bool", "int8", "int16", "int32", "int64"),
        *("uint8", "uint16", "uint32", "uint64", "float16", "float32", "float64"),
    )
}

_MAX_DIMENSIONS = 16
_MAX_PICTURE_PIXELS = 1 << 26  # 64 megapixels: a header can promise more than the machine has


def array_to_bytes(array: npt.NDArray[Any]) -> bytes:
    """Return the elements in C order, little-endian.

    Raises
    ------
    ShapeError
        If the dtype is not one of `ARRAY_DTYPES`, or there are more than 16 dimensions.
    """
    dtype = ARRAY_DTYPES.get(array.dtype.name)
    if dtype is None:
        raise ShapeError(f"an array of {array.dtype} cannot be stored; use one of {', '.join(ARRAY_DTYPES)}")
    if array.ndim > _MAX_DIMENSIONS:
        raise ShapeError(f"an array of {array.ndim} dimensions cannot be stored; {_MAX_DIMENSIONS} are the most")
    return np.asarray(array, dtype=dtype).tobytes()


def array_from_bytes(raw: bytes, dtype_name: str, shape: Sequence[int]) -> npt.NDArray[Any]:
    """Return the array of bytes that `array_to_bytes` gave: read-only, and a view of them where it can be.

    Raises
    ------
    ShapeError
        If the dtype is unknown or the bytes do not fit the shape.
    """
    dtype = ARRAY_DTYPES.get(dtype_name)
    if dtype is None:
        raise ShapeError(f"unknown dtype {in_words(dtype_name)}; use one of {', '.join(ARRAY_DTYPES)}")
    if len(shape) > _MAX_DIMENSIONS or any(length < 0 for length in shape):
        raise ShapeError(f"shape {in_words(list(shape))} is not that of an array")
    if math.prod(shape) * dtype.itemsize != len(raw):
        raise ShapeError(f"shape {in_words(list(shape))} of {dtype_name} does not fit {len(raw)} bytes")
    if not raw:  # zero times anything: lengths that numpy cannot count are refused here
        return _empty(shape, dtype)
    if dtype.kind == "b" and max(raw) > 1:
        raise ShapeError("a truth value is neither 0 nor 1")
    array = np.frombuffer(raw, dtype).reshape(tuple(shape)).astype(dtype.newbyteorder("="), copy=False)
    array.flags.writeable = False
    return array


def array_to_document(array: npt.NDArray[Any]) -> dict[str, Any]:
    """Return an array as ``{"shape", "dtype", "base64"}``.

    Raises
    ------
    ShapeError
        If its dtype is not one of `ARRAY_DTYPES`.
    """
    text = base64.b64encode(array_to_bytes(array)).decode("ascii")
    return {"shape": list(array.shape), "dtype": array.dtype.name, "base64": text}


def array_from_document(document: Mapping[str, Any], where: str = "array") -> npt.NDArray[Any]:
    """Return the array of ``{"shape", "dtype", "base64"}``.

    Raises
    ------
    ConfigError
        If a key is missing, or shape, dtype and bytes do not fit together; the message begins with `where`.
    """
    if set(document) != {"shape", "dtype", "base64"}:
        raise ConfigError(f"{where}: an array has the keys shape, dtype and base64, not {in_words(list(document))}")
    shape, dtype_name, text = document["shape"], document["dtype"], document["base64"]
    if not isinstance(shape, Sequence) or any(type(length) is not int for length in shape):
        raise ConfigError(f"{where}.shape must be a list of whole numbers, not {in_words(shape)}")
    if not isinstance(dtype_name, str) or not isinstance(text, str):
        raise ConfigError(f"{where}: dtype and base64 must be text")
    try:
        return array_from_bytes(base64.b64decode(text, validate=True), dtype_name, shape)
    except (binascii.Error, ShapeError, ValueError) as error:
        raise ConfigError(f"{where}: {error}") from error


def read_array(value: Any, where: str, base_dir: Path | None) -> npt.NDArray[Any]:
    """Return an array that is written as rows of numbers, as shape, dtype and base64, or as a file name.

    Parameters
    ----------
    value : object
        As it stands in a document.
    where : str
        Its place, for messages.
    base_dir : Path or None
        Folder at which file names start; None refuses them.

    Raises
    ------
    ConfigError
        If it is none of these, or the file cannot be read.
    """
    if isinstance(value, str):
        return _read_file(value, where, base_dir)
    if isinstance(value, Mapping):
        return array_from_document(value, where)
    try:
        array = np.asarray(value)
    except (ValueError, OverflowError) as error:
        raise ConfigError(f"{where}: its rows are not numbers of equal count") from error
    if array.dtype.name not in ARRAY_DTYPES:
        raise ConfigError(f"{where} must be numbers, a file name, or shape, dtype and base64, not {in_words(value)}")
    return array


def _read_file(name: str, where: str, base_dir: Path | None) -> npt.NDArray[Any]:
    if base_dir is None:
        raise ConfigError(f"{where} names the file {in_words(name)}, but this document may not read files")
    path = base_dir / name
    reader = {".npy": _read_npy, ".png": _read_png}.get(path.suffix.lower())
    if reader is None:
        raise ConfigError(f"{where}: {in_words(name)} is neither .npy nor .png")
    try:
        return reader(path)
    except FileNotFoundError as error:
        raise ConfigError(f"{where}: no file {path}") from error
    except (OSError, ValueError, OverflowError) as error:
        raise ConfigError(f"{where}: cannot read {path}: {error}") from error


def _read_npy(path: Path) -> npt.NDArray[Any]:
    # mapped first: a header that promises more than the file holds is refused before anything is allocated
    array = np.array(np.lib.format.open_memmap(path, mode="r"))
    if array.dtype.name not in ARRAY_DTYPES:
        raise ValueError(f"it holds {array.dtype}; use one of {', '.join(ARRAY_DTYPES)}")
    return array


def _read_png(path: Path) -> npt.NDArray[Any]:
    import cv2

    raw = path.read_bytes()
    if not is_png(raw) or len(raw) < 24:
        raise ValueError("it is not a PNG picture")
    width, height = struct.unpack(">II", raw[16:24])
    if width * height > _MAX_PICTURE_PIXELS:
        raise ValueError(f"{width} x {height} pixels are more than a calibration needs")
    check_png(raw)
    try:
        picture = cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ValueError("the picture is damaged") from error
    if picture is None:
        raise ValueError("the picture is damaged")
    return picture


def _empty(shape: Sequence[int], dtype: np.dtype[Any]) -> npt.NDArray[Any]:
    try:
        array = np.empty(tuple(shape), dtype.newbyteorder("="))
    except (ValueError, OverflowError, MemoryError) as error:
        raise ShapeError(f"shape {in_words(list(shape))} is not that of an array") from error
    array.flags.writeable = False
    return array


def in_words(value: Any) -> str:
    """Return a value as a message quotes it, at most 60 characters."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
