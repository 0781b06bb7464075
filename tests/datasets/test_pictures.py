"""Pictures: what is read, and what is refused before it does harm."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest

from trailmark.errors import SourceError
from trailmark.sources.pictures import as_payload_pixels, decode_raw, header_size, read_picture


def encoded(suffix: str, pixels: np.ndarray) -> bytes:
    done, data = cv2.imencode(suffix, pixels)
    assert done
    return data.tobytes()


def noise(*shape: int) -> np.ndarray:
    return np.random.default_rng(7).integers(0, 255, shape, dtype=np.uint8)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp", ".ppm"])
def test_the_header_tells_the_size_without_decoding(suffix):
    assert header_size(encoded(suffix, noise(20, 30, 3))) == (30, 20)


def test_a_header_of_absurd_size_is_refused_before_decoding():
    chunk = b"IHDR" + struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    bomb = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))

    with pytest.raises(SourceError, match=r"bomb\.png: the header announces 60000x60000 pixels, more than"):
        decode_raw(bomb, "bomb.png")


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".bmp"])
def test_a_truncated_picture_is_refused(suffix):
    data = encoded(suffix, noise(64, 64, 3))

    with pytest.raises(SourceError, match=r"a: (unreadable|the PNG picture is damaged|the JPEG picture is truncated)"):
        decode_raw(data[: len(data) * 2 // 3], "a")


def test_an_empty_and_a_foreign_file_are_refused(tmp_path):
    empty, foreign = tmp_path / "empty.png", tmp_path / "foreign.png"
    empty.write_bytes(b"")
    foreign.write_text("this is no picture")

    with pytest.raises(SourceError, match=r"empty\.png: the picture is empty"):
        read_picture(empty, str(empty))
    with pytest.raises(SourceError, match=r"foreign\.png: unreadable picture"):
        read_picture(foreign, str(foreign))


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(SourceError, match=r"list\.txt:3: cannot be read: No such file"):
        read_picture(tmp_path / "none.png", "list.txt:3")


@pytest.mark.parametrize(
    ("stored", "grey", "shape", "dtype"),
    [
        (noise(4, 6), None, (4, 6), np.uint8),
        (noise(4, 6), False, (4, 6, 3), np.uint8),
        (noise(4, 6, 3), None, (4, 6, 3), np.uint8),
        (noise(4, 6, 4), None, (4, 6, 3), np.uint8),
        (noise(4, 6, 3), True, (4, 6), np.uint8),
        (noise(4, 6).astype(np.uint16), None, (4, 6), np.uint16),
        (noise(4, 6).astype(np.uint16), True, (4, 6), np.uint8),
        (noise(4, 6, 3).astype(np.uint16), None, (4, 6, 3), np.uint8),
    ],
)
def test_pictures_come_as_stored_or_as_asked(tmp_path, stored, grey, shape, dtype):
    path = tmp_path / "a.png"
    path.write_bytes(encoded(".png", stored))

    pixels = read_picture(path, str(path), grey)

    assert pixels.shape == shape
    assert pixels.dtype == dtype


def test_sixteen_bit_colour_keeps_its_upper_byte():
    wide = np.full((2, 2, 3), 0x1234, np.uint16)

    np.testing.assert_array_equal(as_payload_pixels(wide, "a", None), 0x12)


def test_pixels_of_another_type_are_refused():
    with pytest.raises(SourceError, match="a: pixels of type float32 are no picture"):
        as_payload_pixels(np.zeros((2, 2), np.float32), "a", None)
