"""Localizers that compare the present picture with the taught one nearest along the path."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.errors import ConfigError, ShapeError, StoreError
from trailmark.estimates import Belief, Estimate, Lost, PathOffset, information_along
from trailmark.frames import RGBD, Frame, Image, Pinhole
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, LocalizerMap, Session
from trailmark.patches import patch_scores, peak, small_picture
from trailmark.paths import Keyframe
from trailmark_baselines.appearance.config import (
    AppearanceConfig,
    ColumnNCCConfig,
    PatchNCCConfig,
    PhaseShiftConfig,
)
from trailmark_baselines.appearance.kernels import column_scores, phase_shift

__all__ = ["ColumnNCC", "PatchNCC", "PhaseShift", "TaughtPictures"]

_DEFAULT_VIEW_DEG = 60.0


class TaughtPictures(Localizer):
    """A taught sequence of pictures. Kinds differ in what they keep of a picture and how they find a shift."""

    config: AppearanceConfig

    def start(self, session: Session) -> None:
        """Load the taught pictures.

        Raises
        ------
        ConfigError
            If there is no path, or nothing to remember it with.
        StoreError
            If the path was taught without this localizer.
        """
        self._session = session
        self._localizer_map = self._map_of(session)
        self._is_teaching = session.mode == "teach"
        self._last_m = -math.inf
        self._keyframes: tuple[Keyframe, ...] = ()
        if self._is_teaching:
            return
        if session.path is None:
            raise ConfigError(f"{session.name}: it needs a taught path; give the run --store, or teach one first")
        self._keyframes = tuple(self._localizer_map.keyframes())
        if not self._keyframes:
            raise StoreError(f"{session.name}: nothing of this path is remembered; teach it with this localizer too")
        self._stations_m = np.array([keyframe.station_m for keyframe in self._keyframes])

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Remember a picture, or compare it with the taught one nearest along the path.

        Raises
        ------
        ShapeError
            If the pictures are of another size than the taught ones.
        """
        payload = frame.payload
        if not isinstance(payload, Image | RGBD):
            return ()
        if self._is_teaching:
            self._remember(frame.stamp_s, payload, belief)
            return ()
        if belief.on_path is None:
            return (Lost(frame.stamp_s, "the place on the path is not known"),)
        row = int(np.argmin(np.abs(self._stations_m - belief.on_path.station_m)))
        grey = self._region(payload)
        taught, seen = self._keyframes[row].arrays["picture"], self.describe(grey)
        if taught.shape != seen.shape:
            raise ShapeError(
                f"sensor {frame.sensor!r}: the taught pictures became {taught.shape}, this one {seen.shape};"
                " replay with the size of picture that was taught"
            )
        share, score = self.shift(taught, seen)
        if score < self.config.min_score:
            return (Lost(frame.stamp_s, "no clear match", {"score": score}),)
        return (self._offset(frame, grey.shape[1], float(self._stations_m[row]), share, score),)

    @abstractmethod
    def describe(self, grey: npt.NDArray[np.uint8]) -> npt.NDArray[Any]:
        """Return what is kept of a picture, (H, W) uint8."""

    @abstractmethod
    def shift(self, taught: npt.NDArray[Any], seen: npt.NDArray[Any]) -> tuple[float, float]:
        """Return the shift between two described pictures as a share of the width, and its score."""

    def _remember(self, stamp_s: float, payload: Image | RGBD, belief: Belief) -> None:
        station_m = belief.travelled_m
        if station_m - self._last_m < self.config.spacing_m - 1e-9:
            return
        self._last_m = station_m
        arrays = {"picture": self.describe(self._region(payload))}
        self._localizer_map.add(Keyframe(station_m, stamp_s, belief.pose_map_base or Pose2(), arrays))

    def _region(self, payload: Image | RGBD) -> npt.NDArray[np.uint8]:
        pixels = payload.bgr if isinstance(payload, RGBD) else payload.pixels
        first, last = (round(share * pixels.shape[0]) for share in self.config.region)
        part = np.ascontiguousarray(pixels[first:last])
        if part.ndim == 3:
            import cv2

            part = np.asarray(cv2.cvtColor(part, cv2.COLOR_BGR2GRAY))
        return (part >> 8).astype(np.uint8) if part.dtype == np.uint16 else part

    def _offset(self, frame: Frame, width_px: int, station_m: float, share: float, score: float) -> PathOffset:
        """Return a shift as a turn: one number, which an offset from the path explains as well."""
        config = self.config
        shift_px = share * width_px
        angle_rad = math.atan(shift_px / self._focal_px(frame.sensor, width_px))
        information = information_along((0.0, 1.0 / config.depth_m, 1.0), math.radians(config.sigma_deg))
        details = {"shift_px": shift_px, "shift_deg": math.degrees(angle_rad), "score": score}
        return PathOffset(frame.stamp_s, station_m, 0.0, angle_rad, information, details)

    def _focal_px(self, sensor: str, width_px: int) -> float:
        info = self._session.sensors.get(sensor)
        if self.config.field_of_view_deg is None and info is not None and isinstance(info.calibration, Pinhole):
            return info.calibration.fx
        view_deg = self.config.field_of_view_deg or _DEFAULT_VIEW_DEG
        return width_px / 2.0 / math.tan(math.radians(view_deg) / 2.0)

    def _map_of(self, session: Session) -> LocalizerMap:
        if session.map is None:
            raise ConfigError(f"{session.name}: it remembers a path in a store; give the run --store")
        return session.map


class ColumnNCC(TaughtPictures):
    """Normalised cross-correlation of column means."""

    config: ColumnNCCConfig

    def start(self, session: Session) -> None:
        """Load the taught pictures and compile the kernel."""
        super().start(session)
        column_scores(np.zeros(4), np.zeros(4), 1)

    def describe(self, grey: npt.NDArray[np.uint8]) -> npt.NDArray[Any]:
        """Return the mean brightness of each pixel column, (W,) float32."""
        return np.asarray(grey.mean(axis=0), dtype=np.float32)

    def shift(self, taught: npt.NDArray[Any], seen: npt.NDArray[Any]) -> tuple[float, float]:
        """Return the shift as a share of the width, and its correlation."""
        max_shift = max(1, int(self.config.max_shift * len(seen)))
        shift_px, score = peak(column_scores(taught.astype(np.float64), seen.astype(np.float64), max_shift))
        return shift_px / len(seen), score


class PatchNCC(TaughtPictures):
    """Normalised cross-correlation of small patch-normalised pictures."""

    config: PatchNCCConfig

    def describe(self, grey: npt.NDArray[np.uint8]) -> npt.NDArray[Any]:
        """Return the small normalised picture, (h, w) float32 in [-1, 1]."""
        return small_picture(grey, (self.config.width_px, self.config.height_px), self.config.patch_px)

    def shift(self, taught: npt.NDArray[Any], seen: npt.NDArray[Any]) -> tuple[float, float]:
        """Return the shift as a share of the width, and its correlation."""
        shift_px, score = peak(patch_scores(np.array(taught), np.array(seen)))
        return shift_px / seen.shape[1], score


class PhaseShift(TaughtPictures):
    """Phase correlation of whole pictures."""

    config: PhaseShiftConfig

    def describe(self, grey: npt.NDArray[np.uint8]) -> npt.NDArray[Any]:
        """Return the reduced picture, (h, w) uint8; never enlarged."""
        import cv2

        height, width = grey.shape
        if width <= self.config.width_px:
            return np.array(grey)
        size = self.config.width_px, max(1, round(height * self.config.width_px / width))
        return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA))

    def shift(self, taught: npt.NDArray[Any], seen: npt.NDArray[Any]) -> tuple[float, float]:
        """Return the shift as a share of the width, and the height of the peak."""
        shift_px, score = phase_shift(taught.astype(np.float32), seen.astype(np.float32))
        return shift_px / seen.shape[1], score
