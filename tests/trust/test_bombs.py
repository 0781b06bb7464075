"""A stranger's files that make much from little: pictures, packed logs and models, texts of aliases.

docs/security.md says the same in words, with the names of these tests.
"""

from __future__ import annotations

import gzip
import os
import struct
import time
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.trust.conftest import WHEELS

from trailmark.config import load_run_config
from trailmark.errors import ConfigError, SourceError
from trailmark.plugins import load_plugins
from trailmark.sources.pictures import decode_raw, read_raw
from trailmark_datasets.textfiles import lines_of
from trailmark_omni_surf.selection import SelectionModel, shipped_model


def deflated_zeros(n: int) -> bytes:
    """Return what zlib makes of zeros: a megabyte is packed once, and its packed bytes repeated."""
    packer = zlib.compressobj(9, wbits=-zlib.MAX_WBITS)
    megabyte = packer.compress(bytes(1 << 20)) + packer.flush(zlib.Z_FULL_FLUSH)
    rest = zlib.compress(bytes(n % (1 << 20)), 9, wbits=-zlib.MAX_WBITS)
    adler32 = (n % 65521) << 16 | 1
    return b"\x78\xda" + megabyte * (n >> 20) + rest + adler32.to_bytes(4, "big")


def png(width: int, height: int) -> bytes:
    """Return a PNG of one colour that says it is of a size, with all of its data."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return len(data).to_bytes(4, "big") + name + data + zlib.crc32(name + data).to_bytes(4, "big")

    data = deflated_zeros((1 + width) * min(height, 300))
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def tiff(width: int, height: int) -> bytes:
    """Return a TIFF of one strip that says it is of a size."""
    tags = [(256, 4, width), (257, 4, height), (258, 3, 8), (259, 3, 1), (262, 3, 1), (273, 4, 8), (277, 3, 1)]
    tags += [(278, 4, height), (279, 4, width * height % 2**32)]
    entries = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in sorted(tags))
    return b"II*\0" + struct.pack("<I", 8) + struct.pack("<H", len(tags)) + entries + struct.pack("<I", 0)


@pytest.mark.parametrize(
    "picture",
    [
        *(png(30000, 30000), png(2**31 - 1, 1), tiff(30000, 30000), tiff(20000, 40000)),
        *(b"P5 30000 30000 255\n", b"P7\nWIDTH 30000\nHEIGHT 30000\nDEPTH 1\nMAXVAL 255\nENDHDR\n" + bytes(100)),
        *(b"BM" + bytes(16) + struct.pack("<ii", 30000, -30000) + bytes(100), b"Pf\n30000 30000\n-1.0\n" + bytes(100)),
    ],
    ids=["png", "png-long", "tiff", "tiff-wide", "pgm", "pam", "bmp", "pfm"],
)
def test_a_picture_that_announces_gigabytes_is_refused(picture: bytes) -> None:
    began_s = time.thread_time()

    with pytest.raises(SourceError):
        decode_raw(picture, "the picture")

    assert time.thread_time() - began_s < 0.5


@pytest.mark.parametrize("kind", ["device", "pipe", "folder"])
def test_a_picture_without_end_is_not_read(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "0.png"
    {"device": lambda: path.symlink_to("/dev/zero"), "pipe": lambda: os.mkfifo(path), "folder": path.mkdir}[kind]()

    with pytest.raises(SourceError, match="is no file"):
        read_raw(path, "the picture")


def test_opencv_itself_refuses_what_is_too_large() -> None:
    """Also for formats whose headers are not looked at before."""
    assert int(os.environ["OPENCV_IO_MAX_IMAGE_PIXELS"]) <= 1 << 27
    data = np.frombuffer(b"P7\nWIDTH 20000\nHEIGHT 20000\nDEPTH 1\nMAXVAL 255\nENDHDR\n" + bytes(100), np.uint8)
    with pytest.raises(cv2.error, match=r"IMAGE_PIXELS|pixels"):
        cv2.imdecode(data, cv2.IMREAD_UNCHANGED)


def test_a_log_that_unpacks_to_gigabytes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bomb.log.gz"
    with gzip.open(path, "wb", compresslevel=9) as file:
        block = (b"# " + b" " * 997 + b"\n") * 1000
        for _ in range(100):
            file.write(block)
    assert path.stat().st_size < 1 << 20

    with pytest.raises(SourceError, match="unpacks to more than 100 times its size"):
        list(lines_of(path))


def test_a_model_that_unpacks_to_gigabytes_is_refused(tmp_path: Path) -> None:
    path, whole = tmp_path / "bomb.npz", tmp_path / "whole.npz"
    np.savez_compressed(path, support=np.zeros((10_000_000,), np.float64))
    shipped_model().save(whole)
    assert path.stat().st_size < 1 << 20

    with pytest.raises(ConfigError, match="unpacks to more than"):
        SelectionModel.load(path)
    np.save(tmp_path / "array.npy", np.zeros(3))
    damaged = [path.read_bytes()[:1000], (tmp_path / "array.npy").read_bytes(), whole.read_bytes()[:-30]]
    damaged.append(whole.read_bytes()[:200] + bytes(50) + whole.read_bytes()[250:])
    for content in damaged:
        path.write_bytes(content)
        with pytest.raises(ConfigError, match="is no selection model"):
            SelectionModel.load(path)


def test_aliases_of_aliases_are_no_bomb(wheels: Path) -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 10)]
    (wheels / "config.yaml").write_text("\n".join(lines) + "\n" + WHEELS)
    began_s = time.thread_time()

    with pytest.raises(ConfigError) as raised:
        load_run_config(wheels / "config.yaml", plugins=load_plugins())

    assert time.thread_time() - began_s < 5.0
    assert len(str(raised.value)) < 20_000


def test_a_value_of_aliases_is_no_bomb(wheels: Path) -> None:
    lines = ["seed: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    for i, key in enumerate(("mode", "start", "pace", "control_hz", "sensors", "sinks", "controller"), 1):
        lines.append(f"{key}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]")
    (wheels / "config.yaml").write_text("\n".join(lines) + "\n" + WHEELS)
    began_s = time.thread_time()

    with pytest.raises(ConfigError) as raised:
        load_run_config(wheels / "config.yaml", plugins=load_plugins())

    assert time.thread_time() - began_s < 5.0
    assert len(str(raised.value)) < 20_000
