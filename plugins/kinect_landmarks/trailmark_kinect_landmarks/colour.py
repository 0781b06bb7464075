"""Colour: compensation of the light, and the histograms by which landmarks are matched."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.arrays import Bgr8
from trailmark_kinect_landmarks.kernels import colour_counts

__all__ = ["HUES", "SATURATIONS", "Light", "colour_index", "compensate", "histograms", "picture_light", "similarity"]


HUES, SATURATIONS, _GREYS = 12, 2, 4
_N_BINS = HUES * SATURATIONS + _GREYS  # coloured pixels by hue and saturation, the rest by brightness
_LEAST_SATURATION, _LEAST_VALUE = 50, 40


def picture_light(grey: npt.NDArray[np.uint8]) -> float:
    """Return the ambient light as the picture itself shows it: mean grey level, 0 to 1."""
    return float(grey[::8, ::8].mean()) / 255.0


@dataclass(frozen=True, slots=True)
class Light:
    """How bright it is.

    Attributes
    ----------
    picture : float
        Mean grey level of the picture, 0 to 1.
    measured : float or None
        By a sensor of ambient light, in its unit.
    """

    picture: float
    measured: float | None = None

    def share_of(self, reference: Light) -> float:
        """Return the light as a share of the reference: by the sensor where there is one, else by the picture."""
        if self.measured is not None and reference.measured is not None:
            return self.measured / max(reference.measured, 1e-6)
        return self.picture / max(reference.picture, 1e-6)

    def gain_to(self, reference: Light) -> float:
        """Return the factor that takes grey levels to the reference.

        The picture tells how its camera took the change of light: in full, by the root of it, or not at all where it
        exposes by itself. The sensor tells how much of that was light and not another view.
        """
        gain = reference.picture / max(self.picture, 1e-6)
        if self.measured is None or reference.measured is None:
            return gain
        most = reference.measured / max(self.measured, 1e-6)
        return min(max(gain, min(1.0, most)), max(1.0, most))


def compensate(bgr: Bgr8, gain: float, max_gain: float = 6.0) -> Bgr8:
    """Return the picture as it would look in the reference light.

    Parameters
    ----------
    bgr : (H, W, 3) uint8
        Picture.
    gain : float
        Of `Light.gain_to`.
    max_gain : float
        More would only show noise.
    """
    gain = min(max(gain, 1.0 / max_gain), max_gain)
    if abs(gain - 1.0) < 0.1:  # within a tenth the histograms do not change; saves a copy
        return bgr
    return np.asarray(cv2.convertScaleAbs(bgr, alpha=gain), dtype=np.uint8)


def colour_index(hsv: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Return the histogram bin of every pixel, (H, W) of 0 to 27: a picture of labels, made once per frame."""
    hue, saturation, value = cv2.split(hsv)
    coloured = np.asarray(hue, np.uint8) // (180 // HUES) * SATURATIONS + (np.asarray(saturation) >= 128)
    grey = HUES * SATURATIONS + (np.asarray(value, np.uint8) >> 6)
    is_grey = (np.asarray(saturation) < _LEAST_SATURATION) | (np.asarray(value) < _LEAST_VALUE)
    return np.where(is_grey, grey, coloured).astype(np.uint8)


def histograms(index: npt.NDArray[np.uint8], uv: npt.NDArray[np.float64], radius_px: int) -> npt.NDArray[np.float32]:
    """Return the colour histograms around pixels, (N, 28), each with sum 1; windows end at the border."""
    found = colour_counts(index, np.rint(uv).astype(np.intp), radius_px, _N_BINS)
    found /= np.maximum(found.sum(axis=1, keepdims=True), 1.0)
    return found


def similarity(first: npt.NDArray[np.float32], second: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return the Bhattacharyya coefficients of histograms, (N, B) and (M, B) to (N, M); 1: the same."""
    return np.asarray(np.dot(np.sqrt(first), np.sqrt(second).T), dtype=np.float32)
