"""Panoramas that are already unwrapped: the width of the picture is the full turn, as 360 degree cameras give it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Bools, Floats, Grey8
from trailmark.frames import Omni

__all__ = ["PanoramaCamera", "PanoramaFinder"]


@dataclass(frozen=True, slots=True)
class PanoramaCamera:
    """Turns pixels of an unwrapped panorama into bearings.

    Attributes
    ----------
    width_px, height_px : int
        Size of the picture; its width is 360 deg [px].
    sign : float
        1 where bearings, counter-clockwise, grow to the right, -1 where to the left.
    forward_u : float
        Column of the sensor's forward axis [px].
    """

    width_px: int
    height_px: int
    sign: float
    forward_u: float

    @classmethod
    def of(cls, calibration: Omni, shape: tuple[int, ...]) -> PanoramaCamera:
        """Return the camera of a picture's shape.

        `forward_deg` of the calibration is counted from the left edge of the picture to the right, and `turns` says
        which way one turns, seen from above, who looks from its left to its right: clockwise in most panoramas.
        """
        height, width = shape[:2]
        sign = -1.0 if calibration.turns == "clockwise" else 1.0
        return cls(width, height, sign, math.radians(calibration.forward_deg) / (2.0 * math.pi) * width - 0.5)

    def bearings(self, uv: Floats) -> Floats:
        """Return the bearing of every pixel in sensor axes, counter-clockwise from forward, (N,) [rad]."""
        turns = (uv[:, 0] - self.forward_u) / self.width_px
        return np.asarray(np.mod(self.sign * 2.0 * np.pi * turns + np.pi, 2.0 * np.pi) - np.pi)

    def distances(self, uv: Floats) -> Floats:
        """Return the distance of every pixel from the lower edge, where the ground below the camera is, (N,) [px]."""
        return np.asarray(self.height_px - 0.5 - uv[:, 1])

    def pixels(self, bearings: Floats, shares: Floats) -> Floats:
        """Return the pixels under bearings [rad], (N, 2); shares run from the lower edge, 0, to the upper, 1."""
        columns = self.forward_u + self.sign * bearings / (2.0 * np.pi) * self.width_px
        columns = np.clip(np.mod(columns + 0.5, self.width_px) - 0.5, 0.0, self.width_px - 1.0)
        return np.stack([columns, (1.0 - shares) * (self.height_px - 1.0)], axis=1)

    def is_inside(self, uv: Floats, margin_px: float = 4.0) -> Bools:
        """Return which pixels lie in the picture and at least a margin from its edges."""
        is_across = (uv[:, 0] > margin_px - 0.5) & (uv[:, 0] < self.width_px - 0.5 - margin_px)
        is_upright = (uv[:, 1] > margin_px - 0.5) & (uv[:, 1] < self.height_px - 0.5 - margin_px)
        return np.asarray(is_across & is_upright)


@dataclass(slots=True)
class PanoramaFinder:
    """Takes every picture of one size for a panorama; there is no circle to look for.

    Parameters
    ----------
    calibration : Omni
        Which way the picture turns, and where forward is.
    """

    calibration: Omni
    _camera: PanoramaCamera | None = None

    @classmethod
    def of(cls, calibration: Omni | None) -> PanoramaFinder:
        """Return the finder for a camera; one that is not calibrated looks forward in the middle, left to the left."""
        return cls(calibration or Omni(turns="clockwise", forward_deg=180.0))

    @property
    def camera(self) -> PanoramaCamera:
        """What turns pixels into bearings; after a `look` without a problem."""
        assert self._camera is not None
        return self._camera

    def look(self, image: Grey8) -> str:
        """Take the size of the first picture; return what is wrong, in words, or nothing."""
        found = PanoramaCamera.of(self.calibration, image.shape)
        if found.width_px < 2 * found.height_px:
            return (
                f"no panorama: {found.width_px} x {found.height_px} px are less than twice as wide as high;"
                " leave out 'unwrapped' for the circular picture of a mirror or fisheye"
            )
        if self._camera is not None and self._camera != found:
            was = self._camera
            return (
                f"the pictures were {was.width_px} x {was.height_px} px, this one {found.width_px} x {found.height_px}"
            )
        self._camera = found
        return ""
