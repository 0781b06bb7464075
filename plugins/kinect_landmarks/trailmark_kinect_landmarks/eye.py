"""Looking at a picture: compensate the light, correct depth, find landmarks, describe and measure them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.frames import RGBD, Scan
from trailmark_kinect_landmarks.camera import LandmarkCamera
from trailmark_kinect_landmarks.colour import Light, compensate, picture_light
from trailmark_kinect_landmarks.config import KinectLandmarksConfig
from trailmark_kinect_landmarks.finders import WorkingImage, find
from trailmark_kinect_landmarks.fuzzy import SearchPlan
from trailmark_kinect_landmarks.landmarks import KINDS, SeenLandmarks, anchors, describe, spread_out

__all__ = ["LandmarkDetector", "PreparedImage"]

Kinds = npt.NDArray[np.int8]

_SIGMA_PX = {"corner": 1.0, "centre": 2.5}
_APART_PX, _APART_AT = 12.0, 60  # so far apart when so many are wanted; fewer are spread wider
_MARGIN_PX = 6
_LEAST_CORNERNESS = 2e-5  # below it a pixel is like its neighbours and cannot be found again


@dataclass(frozen=True, slots=True, eq=False)
class PreparedImage:
    """A picture made ready.

    Attributes
    ----------
    original : (H, W, 3) uint8
        As it came.
    view : WorkingImage
        Compensated colour and corrected depth, for the finders.
    grey : (H, W) uint8
        Compensated, whole.
    registered_m, depth_m : (H, W) float32
        Depth as the colour camera sees it, before and after correction [m].
    light : float
        Ambient light as a share of the reference.
    scan : Scan or None
        The newest sweep of the laser.
    """

    original: npt.NDArray[np.uint8]
    view: WorkingImage
    grey: npt.NDArray[np.uint8]
    registered_m: npt.NDArray[np.float32]
    depth_m: npt.NDArray[np.float32]
    light: float
    scan: Scan | None

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [px]."""
        return self.grey.shape[1], self.grey.shape[0]


class LandmarkDetector:
    """Prepares pictures and sees landmarks in them.

    Parameters
    ----------
    config : KinectLandmarksConfig
        Which finders, which pixel.
    camera : LandmarkCamera
        Measures.
    """

    def __init__(self, config: KinectLandmarksConfig, camera: LandmarkCamera) -> None:
        self._config, self._camera = config, camera
        #: Light in which landmarks were remembered; None at first.
        self.reference_light: Light | None = None

    def prepare(self, payload: RGBD, measured_light: float | None, scan: Scan | None, scale: float) -> PreparedImage:
        """Return the picture in the reference light, with its depth registered and corrected."""
        light = Light(picture_light(np.asarray(payload.bgr[..., 1])), measured_light)  # green stands for brightness
        if self.reference_light is None:
            self.reference_light = light
        bgr = compensate(payload.bgr, light.gain_to(self.reference_light))
        registered_m = self._camera.register_depth(payload)
        original_grey = np.asarray(cv2.cvtColor(payload.bgr, cv2.COLOR_BGR2GRAY), np.uint8)
        depth_m = self._camera.clean_depth(registered_m, original_grey)
        is_as_it_came = bgr is payload.bgr
        grey = original_grey if is_as_it_came else np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY), np.uint8)
        view = WorkingImage(bgr, depth_m, scale, grey)
        return PreparedImage(payload.bgr, view, grey, registered_m, depth_m, light.share_of(self.reference_light), scan)

    def find(self, picture: PreparedImage, plan: SearchPlan, taken_uv: Floats, n: int) -> SeenLandmarks:
        """Return up to `n` landmarks that the finders see and that have depth, away from those that are known."""
        regions = find(picture.view, plan.finders)
        uv, strength = anchors(picture.grey, regions, self._config.point)
        last = np.array(picture.size) - 1 - _MARGIN_PX
        good = np.all((uv >= _MARGIN_PX) & (uv <= last), axis=1) & (strength > _LEAST_CORNERNESS)
        if picture.scan is None:
            good &= _has_depth(picture.depth_m, uv)
        rows = np.flatnonzero(good)
        # more than wanted, since depth may turn out to be that of two surfaces
        apart_px = max(_APART_PX, _APART_PX * math.sqrt(_APART_AT / self._config.landmarks))
        rows = rows[spread_out(uv[rows], strength[rows], taken_uv, apart_px, 2 * n)]
        kind = np.array([KINDS.index(regions.kinds[row]) for row in rows], dtype=np.int8)
        side = regions.boxes[rows, 2:].max(axis=1)
        seen = self.look_at(picture, uv[rows], kind, side)
        return seen.rows(np.flatnonzero(np.isfinite(seen.points_base).all(axis=1))[:n])

    def look_at(self, picture: PreparedImage, uv: Floats, kind: Kinds, side_px: Floats) -> SeenLandmarks:
        """Return what is seen at pixels; landmarks without depth have NaN points."""
        lens = self._camera.lens(picture.size)
        measured = self._camera.measure(uv, picture.depth_m, _SIGMA_PX[self._config.point], picture.scan)
        histogram, vicinity = describe(picture.grey, picture.view.half.index, uv)
        size_m = side_px * np.nan_to_num(measured.sights.dV, nan=1.0) / lens.fx
        return SeenLandmarks(uv, kind, size_m, histogram, vicinity, measured.points_base, measured.cov_base)


def _has_depth(depth_m: npt.NDArray[np.float32], uv: Floats) -> npt.NDArray[np.bool_]:
    """Return which pixels have depth themselves."""
    last = np.array(depth_m.shape[::-1]) - 1
    whole = np.clip(np.rint(uv).astype(np.intp), 0, last)
    return np.asarray(np.isfinite(depth_m[whole[:, 1], whole[:, 0]]))
