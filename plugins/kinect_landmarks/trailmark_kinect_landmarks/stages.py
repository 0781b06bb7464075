"""The paper's six stage pictures (Figures 5-10), one set per picture of the camera."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.arrays import Bgr8
from trailmark.errors import ConfigError
from trailmark_kinect_landmarks.camera import LandmarkCamera
from trailmark_kinect_landmarks.eye import PreparedImage
from trailmark_kinect_landmarks.landmarks import KINDS, TrackedLandmarks

__all__ = ["StagePictures", "depth_colours"]


_FAR_M = 6.0
_MARK = (60, 220, 60)


class StagePictures:
    """Writes original, landmarks, calibrated, depth, corrected depth and angles as PNG files.

    Parameters
    ----------
    folder : Path
        Where to; it is made.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._n = folder, 0
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"debug_images: cannot make the folder {folder}: {error.strerror}") from error

    def write(self, stamp_s: float, picture: PreparedImage, sighting: TrackedLandmarks, camera: LandmarkCamera) -> None:
        """Write the six pictures of one frame: ``000012_6_angles.png`` and so on."""
        landmarks = _with_landmarks(picture.original, sighting)
        angles = _with_angles(landmarks, sighting, camera)
        corrected = depth_colours(picture.depth_m)
        stages = {
            "1_original": picture.original,
            "2_landmarks": landmarks,
            "3_calibrated": _with_landmarks(_where_both_see(picture), sighting),
            "4_depth": depth_colours(picture.registered_m),
            "5_corrected_depth": corrected,
            "6_angles": np.asarray(cv2.addWeighted(angles, 0.7, corrected, 0.3, 0.0), np.uint8),
        }
        for name, pixels in stages.items():
            cv2.imwrite(str(self._folder / f"{self._n:06d}_{name}.png"), pixels)
        self._n += 1


def depth_colours(depth_m: npt.NDArray[np.float32]) -> Bgr8:
    """Return depth as colours, near ones warm; black where unknown."""
    known = np.isfinite(depth_m)
    share = np.where(known, 255.0 * (1.0 - np.clip(depth_m / _FAR_M, 0.0, 1.0)), 0.0).astype(np.uint8)
    coloured = np.array(cv2.applyColorMap(share, cv2.COLORMAP_JET), dtype=np.uint8)
    coloured[~known] = 0
    return coloured


def _where_both_see(picture: PreparedImage) -> Bgr8:
    """Return the compensated colour picture, dark where the depth camera does not look."""
    seen = np.isfinite(picture.registered_m)
    columns, rows = np.flatnonzero(seen.any(axis=0)), np.flatnonzero(seen.any(axis=1))
    pixels = picture.view.whole // 4
    if len(columns) and len(rows):
        inside = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        pixels[inside] = picture.view.whole[inside]
    return np.asarray(pixels, np.uint8)


def _with_landmarks(bgr: Bgr8, sighting: TrackedLandmarks) -> Bgr8:
    pixels = bgr.copy()
    for (u, v), kind, row in zip(np.rint(sighting.seen.uv).astype(int), sighting.seen.kind, sighting.rows, strict=True):
        cv2.rectangle(pixels, (int(u) - 7, int(v) - 7), (int(u) + 7, int(v) + 7), _MARK, 1)
        where = int(u) + 9, int(v) + 4
        cv2.putText(pixels, f"{row} {KINDS[kind]}", where, cv2.FONT_HERSHEY_SIMPLEX, 0.35, _MARK, 1)
    return pixels


def _with_angles(bgr: Bgr8, sighting: TrackedLandmarks, camera: LandmarkCamera) -> Bgr8:
    """Draw for every landmark the angle from the axis and the distance."""
    pixels = bgr.copy()
    height, width = pixels.shape[:2]
    foot = int(camera.lens((width, height)).cx), height - 1
    points = camera.in_camera(sighting.seen.points_base)
    for (u, v), (ahead, left, _) in zip(np.rint(sighting.seen.uv).astype(int), points, strict=True):
        cv2.line(pixels, foot, (int(u), int(v)), (255, 255, 255), 1)
        text = f"{math.degrees(math.atan2(-left, ahead)):.1f} deg {ahead:.2f} m"
        cv2.putText(pixels, text, (int(u) + 9, int(v) + 16), cv2.FONT_HERSHEY_SIMPLEX, 0.35, (255, 255, 255), 1)
    return pixels
