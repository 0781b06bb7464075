"""Readings as pictures, to be looked at."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from trailmark.arrays import AnyArray, Float32s, Grey8
from trailmark.errors import ConfigError
from trailmark.frames import RGBD, Image, Payload, Scan

__all__ = ["picture_of", "read_grey"]

_SCAN_PX = 640
_FAR_M = 8.0


def picture_of(payload: Payload) -> AnyArray:
    """Return a reading as a grey or BGR picture.

    Colour and depth stand side by side; a scan is seen from above, the sensor in the middle, forward up.

    Raises
    ------
    ConfigError
        If the reading is nothing to look at: odometry, for example.
    """
    if isinstance(payload, Image):
        return payload.pixels
    if isinstance(payload, RGBD):
        return _beside(payload.bgr, _depth_picture(payload.depth_m))
    if isinstance(payload, Scan):
        return _scan_picture(payload)
    raise ConfigError(f"a reading of kind {type(payload).__name__} is no picture: {payload}")


def read_grey(path: Path) -> Grey8:
    """Read a picture as grey levels; the name may hold any characters.

    Raises
    ------
    ConfigError
        If it is not there, or no picture.
    """
    if not path.is_file():
        raise ConfigError(f"the picture {str(path)!r} is not there")
    data = np.fromfile(path, dtype=np.uint8)
    grey = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size else None
    if grey is None:
        raise ConfigError(f"{str(path)!r} is not a picture that OpenCV can read")
    return np.asarray(grey, dtype=np.uint8)


def _depth_picture(depth_m: Float32s) -> Grey8:
    """Return near as warm and far as cold colours; black where the depth is unknown."""
    known = np.isfinite(depth_m)
    near = np.clip(1.0 - np.where(known, depth_m, _FAR_M) / _FAR_M, 0.0, 1.0)
    picture = cv2.applyColorMap((near * 255).astype(np.uint8), cv2.COLORMAP_TURBO)
    picture[~known] = 0
    return np.asarray(picture, dtype=np.uint8)


def _scan_picture(scan: Scan) -> Grey8:
    reach_m = min(scan.range_max_m, float(np.nanmax(scan.ranges_m, initial=1.0)) * 1.1)
    picture = np.full((_SCAN_PX, _SCAN_PX), 255, dtype=np.uint8)
    middle, scale = _SCAN_PX // 2, _SCAN_PX / 2.0 / reach_m
    for x, y in scan.points():
        cv2.circle(picture, (round(middle - y * scale), round(middle - x * scale)), 1, 0, -1)
    cv2.circle(picture, (middle, middle), 4, 128, -1)
    return picture


def _beside(left: Grey8, right: Grey8) -> Grey8:
    picture = np.zeros((max(left.shape[0], right.shape[0]), left.shape[1] + right.shape[1], 3), dtype=np.uint8)
    picture[: left.shape[0], : left.shape[1]] = left
    picture[: right.shape[0], left.shape[1] :] = right
    return picture
