"""A film."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import cv2

from trailmark.errors import SourceError
from trailmark.frames import Image, SensorInfo
from trailmark.sources import Reading, Readings, RecordedSource
from trailmark.sources.pictures import as_payload_pixels
from trailmark_datasets.config import VideoConfig

__all__ = ["Video"]


class Video(RecordedSource):
    """The frames of a film, at the times that stand in the file or at a rate; the first has stamp 0."""

    config: VideoConfig
    _name = ""
    _lasts_s: float | None = None

    def open_recording(self, name: str) -> Iterable[SensorInfo]:
        self._name = name or "camera"
        with self._capture() as capture:
            if not capture.grab():
                raise SourceError(f"{self.config.path}: no frames: {_why_no_frames(self.config.path)}")
            first = self._retrieve_picture(capture, f"{self.config.path} frame 0")
            rate_hz = self.config.rate_hz or float(capture.get(cv2.CAP_PROP_FPS))
            announced = float(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        self._lasts_s = announced / rate_hz if announced > 0 and rate_hz > 0 else None
        self.expect_form(self._name, first)
        return (SensorInfo(self._name, "image", size=first.size, rate_hz=rate_hz if rate_hz > 0 else None),)

    def lasts_s(self) -> float | None:
        """Return what the film says of its length."""
        return self._lasts_s

    def readings(self) -> Readings:
        rate_hz, last_s = self.config.rate_hz, -1.0
        with self._capture() as capture:
            index = 0
            while capture.grab():
                where = f"{self.config.path} frame {index}"
                stamp_s = index / rate_hz if rate_hz else capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3
                if stamp_s <= last_s:  # a container without times: all would be dropped as repeated
                    yield SourceError(f"{where}: the film gives it {stamp_s:.6f} s after {last_s:.6f} s; set rate_hz")
                else:
                    last_s = stamp_s
                    yield Reading(self._name, stamp_s, where, partial(self._retrieve_picture, capture, where))
                index += 1
            announced = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        self.counted["announced_but_missing"] = max(0, announced - index)

    @contextmanager
    def _capture(self) -> Iterator[cv2.VideoCapture]:
        capture = cv2.VideoCapture(str(self.config.path))
        try:
            yield capture
        finally:
            capture.release()

    def _retrieve_picture(self, capture: cv2.VideoCapture, where: str) -> Image:
        decoded, pixels = capture.retrieve()
        if not decoded or pixels is None:
            raise SourceError(f"{where}: cannot be decoded")
        return Image(as_payload_pixels(pixels, where, bool(self.config.grey)))


def _why_no_frames(path: Path) -> str:
    """Return a guess: an MP4 may have its index at the end, which a recorder that is cut off never writes."""
    kinds = list(_mp4_boxes(path)) if path.is_file() else []
    if kinds[:1] == [b"ftyp"] and b"moov" not in kinds:
        return "an MP4 without its index: was the recorder cut off? `untrunc` may mend it, and a .mkv needs no index"
    return "no film, or a codec that OpenCV does not know"


def _mp4_boxes(path: Path) -> Iterator[bytes]:
    """Yield the kinds of the boxes that a file consists of, if it is an MP4."""
    with path.open("rb") as file:
        while len(head := file.read(8)) == 8:
            yield head[4:]
            size = int.from_bytes(head[:4], "big")
            skip = int.from_bytes(file.read(8), "big") - 16 if size == 1 else size - 8
            if skip < 0:  # the last box, or no box
                return
            file.seek(skip, 1)
