"""What the cameras saw: a few small pictures of each, spread over the run."""

from __future__ import annotations

import re
from base64 import b64encode
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

import numpy as np

from trailmark.arrays import AnyArray, Grey8
from trailmark.errors import DataError
from trailmark.frames import Frame
from trailmark.report.html import text_html
from trailmark.writing import write_whole

__all__ = ["FOLDER", "PICTURE_NAME", "Glimpses", "glimpses_section", "jpeg_of", "small_picture"]

#: In the folder of a run.
FOLDER = "pictures"

_N_KEPT = 12
_WIDTH_PX = 320
_QUALITY = 80
#: Of a picture: its camera, and the time since the start.
PICTURE_NAME = re.compile(r"([a-z][a-z0-9_]*)_([0-9]+\.[0-9]{2})s\.jpg")
# A page of a stranger's folder stays small.
_MAX_FILES = 60
_MAX_BYTES = 200_000


@dataclass(slots=True)
class _PictureStrip:
    """Pictures of one camera: every `stride`-th of those that came."""

    stride: int = 1
    n_seen: int = 0
    kept: list[tuple[float, Grey8]] = field(default_factory=list)


class Glimpses:
    """Keeps six to twelve pictures of each camera while a run goes on, however long it is.

    When there is one too many every second is let go, and only half as many are taken from then on.
    """

    def __init__(self) -> None:
        self._cameras: dict[str, _PictureStrip] = {}
        self._began_s: float | None = None

    def see(self, frame: Frame | None) -> None:
        """Keep a glimpse of a frame with a picture."""
        if frame is None:
            return
        if self._began_s is None:
            self._began_s = frame.stamp_s
        pixels = frame.payload.picture
        if pixels is None:
            return
        camera = self._cameras.setdefault(frame.sensor, _PictureStrip())
        if camera.n_seen % camera.stride == 0:
            camera.kept.append((frame.stamp_s - self._began_s, small_picture(pixels)))
        camera.n_seen += 1
        if len(camera.kept) > _N_KEPT:
            camera.kept, camera.stride = camera.kept[::2], 2 * camera.stride

    def write(self, folder: Path) -> None:
        """Write the pictures below the folder of a run, named by camera and time since the start.

        Raises
        ------
        DataError
            If they cannot be written.
        """
        try:
            for sensor, camera in self._cameras.items():
                (folder / FOLDER).mkdir(exist_ok=True)
                for time_s, picture in camera.kept:
                    write_whole(folder / FOLDER / f"{sensor}_{time_s:.2f}s.jpg", jpeg_of(picture))
        except OSError as error:
            raise DataError(f"cannot write pictures into {folder}: {error.strerror or error}") from error


def glimpses_section(folder: Path) -> str:
    """Return the pictures that a run has left, a row for each camera."""
    rows: dict[str, list[tuple[float, str]]] = {}
    for path in sorted((folder / FOLDER).glob("*.jpg"))[:_MAX_FILES]:
        named = PICTURE_NAME.fullmatch(path.name)
        if named is None or path.is_symlink() or path.stat().st_size > _MAX_BYTES:
            continue
        rows.setdefault(named[1], []).append((float(named[2]), b64encode(path.read_bytes()).decode()))
    if not rows:
        return ""
    parts = [text_html("What the cameras saw", "h2")]
    for sensor, pictures in rows.items():
        figures = [_figure(sensor, time_s, data) for time_s, data in sorted(pictures)]
        parts.append(f'<div class="glimpses">\n{"".join(figures)}\n</div>')
    return "\n".join(parts)


def _figure(sensor: str, time_s: float, data: str) -> str:
    words = escape(f"{sensor}, {time_s:.1f} s")
    image = (
        f'<img src="data:image/jpeg;base64,{data}" alt="{words}" data-sensor="{escape(sensor)}" data-time="{time_s}">'
    )
    return f"<figure>{image}<figcaption>{words}</figcaption></figure>"


def jpeg_of(picture: Grey8) -> bytes:
    """Return a picture as a JPEG."""
    import cv2

    _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return data.tobytes()


def small_picture(pixels: AnyArray) -> Grey8:
    """Return a copy with 8 bits, no wider than `_WIDTH_PX`."""
    import cv2

    if pixels.dtype == np.uint16:
        pixels = (pixels >> 8).astype(np.uint8)
    height, width = pixels.shape[:2]
    if width <= _WIDTH_PX:
        return np.array(pixels, dtype=np.uint8)
    size = (_WIDTH_PX, max(1, round(height * _WIDTH_PX / width)))
    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
