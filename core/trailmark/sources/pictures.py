"""Reads picture files and encoded pictures, with errors that name them."""

from __future__ import annotations

import os
import re
import struct
from pathlib import Path

import cv2
import numpy as np

from trailmark.arrays import AnyArray
from trailmark.errors import SourceError
from trailmark.frames.png import check_png, is_png

__all__ = [
    "MAX_PIXELS",
    "PICTURE_SUFFIXES",
    "as_payload_pixels",
    "decode_raw",
    "header_size",
    "read_picture",
    "read_raw",
]


if "OPENCV_LOG_LEVEL" not in os.environ:  # what a picture cannot be read for is said below, once
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_FATAL)

#: What `image_folder` and its like take for a picture.
PICTURE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".pnm", ".tif", ".tiff", ".webp"})

#: A picture whose header announces more is not decoded: a few bytes can announce terabytes.
MAX_PIXELS = 1 << 27

_PNM = re.compile(rb"P[1-6](?:\s|#[^\n]*\n)+(\d+)(?:\s|#[^\n]*\n)+(\d+)")
_JPEG_END = b"\xff\xd9"


def read_picture(path: Path, where: str, grey: bool | None = None) -> AnyArray:
    """Read a picture file.

    Parameters
    ----------
    path : Path
        The file.
    where : str
        What messages call it; it names the file.
    grey : bool, optional
        True: (H, W) uint8; False: (H, W, 3) uint8; None: as stored, then also (H, W) uint16.

    Raises
    ------
    SourceError
        If it is missing, unreadable, truncated, or of absurd size.
    """
    return as_payload_pixels(read_raw(path, where), where, grey)


def read_raw(path: Path, where: str) -> AnyArray:
    """Read a picture file of any depth and type, for depth pictures too; errors as for `read_picture`."""
    try:
        if path.exists() and not path.is_file():  # a list may name /dev/zero, which has no end
            raise SourceError(f"{where}: {path} is no file")
        data = path.read_bytes()
    except OSError as error:
        raise SourceError(f"{where}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # a name with a null byte
        raise SourceError(f"{where}: cannot be read: {error}") from error
    return decode_raw(data, where)


def decode_raw(data: bytes, where: str) -> AnyArray:
    """Decode an encoded picture to whatever it holds; errors as for `read_picture`."""
    if not data:
        raise SourceError(f"{where}: the picture is empty (0 bytes)")
    size = header_size(data)
    if size is not None and size[0] * size[1] > MAX_PIXELS:
        raise SourceError(f"{where}: the header announces {size[0]}x{size[1]} pixels, more than {MAX_PIXELS}")
    if is_png(data):
        try:
            check_png(data)
        except ValueError as error:
            raise SourceError(f"{where}: {error}") from error
    if data.startswith(b"\xff\xd8") and _JPEG_END not in data[-4096:]:  # some decoders fill the rest with grey
        raise SourceError(f"{where}: the JPEG picture is truncated ({len(data)} bytes)")
    try:
        decoded = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise SourceError(f"{where}: unreadable picture: {error.err or error}") from error
    if decoded is None:
        raise SourceError(f"{where}: unreadable picture: truncated, corrupt or of an unknown format")
    return decoded


def as_payload_pixels(pixels: AnyArray, where: str, grey: bool | None) -> AnyArray:
    """Bring decoded pixels to what an `Image` holds: alpha dropped, 16-bit colour cut to 8 bits."""
    if pixels.dtype not in (np.uint8, np.uint16):
        raise SourceError(f"{where}: pixels of type {pixels.dtype} are no picture: 8 or 16 bits are understood")
    if pixels.ndim == 3:
        pixels = pixels[:, :, 0] if pixels.shape[2] < 3 else pixels[:, :, :3]
    if pixels.dtype == np.uint16 and (pixels.ndim == 3 or grey is not None):
        pixels = (pixels >> 8).astype(np.uint8)
    if grey is True and pixels.ndim == 3:
        return cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    if grey is False and pixels.ndim == 2:
        return cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR)
    return np.ascontiguousarray(pixels)


def header_size(data: bytes) -> tuple[int, int] | None:
    """Return width and height from the header of a PNG, JPEG, BMP or PNM picture; None for other files."""
    if data.startswith(b"\x89PNG\r\n\x1a\n") and len(data) >= 24:
        width, height = struct.unpack(">II", data[16:24])
        return width, height
    if data.startswith(b"BM") and len(data) >= 26:
        width, height = struct.unpack("<ii", data[18:26])
        return abs(width), abs(height)
    if data.startswith(b"\xff\xd8"):
        return _jpeg_size(data)
    match = _PNM.match(data[:1024])
    return (int(match[1]), int(match[2])) if match else None


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Walk the segments to the frame header (SOF)."""
    position = 2
    while position + 9 <= len(data) and data[position] == 0xFF:
        marker = data[position + 1]
        if marker == 0xFF:  # fill byte
            position += 1
            continue
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", data[position + 5 : position + 9])
            return width, height
        position += 2 + int(struct.unpack(">H", data[position + 2 : position + 4])[0])
    return None
