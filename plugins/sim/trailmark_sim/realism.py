"""Statistics of pictures, to hold simulated ones against photographs."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from trailmark.arrays import AnyArray, Grey8
from trailmark.errors import ConfigError, ShapeError
from trailmark_sim.pictures import read_grey

__all__ = ["PictureStatistics", "photo_statistics", "picture_statistics", "spectral_slope"]

#: Pictures with a shorter side have windows and patches of their own size.
_LARGE_PX = 256
#: Where the slope is fitted, in cycles over 256 px: from structures of 64 px to 3 px.
_SPECTRUM_BAND = (4, 90)
_N_PATCHES = 160
_SMALLEST_PX = 96
_WINDOW_PX = (512, 480)


@dataclass(frozen=True, slots=True)
class PictureStatistics:
    """What makes a picture easy or hard to track.

    Attributes
    ----------
    std : float
        Contrast: standard deviation of the greys [grey levels].
    slope : float
        Power of the spectrum falls with this exponent of the frequency; 0 is white noise, 2 to 3 a landscape.
    sift : float
        SIFT key points per megapixel.
    corners : float
        Corners (Shi & Tomasi, quality 0.01, 5 px apart) per megapixel.
    edges : float
        Share of Canny edges (80, 160).
    distinct : float
        How much worse the second-best place of a 44 x 44 patch within 32 px is than the best, with noise of 2:
        the ratio of their rms differences, median over patches. 1 is hopeless. In a picture of less than 256 px the
        patch is 22 x 22 and the reach 16 px.
    """

    std: float
    slope: float
    sift: float
    corners: float
    edges: float
    distinct: float

    @classmethod
    def mean(cls, several: list[PictureStatistics]) -> PictureStatistics:
        """Return the mean over pictures."""
        columns = (np.mean([getattr(one, field.name) for one in several]) for field in fields(cls))
        return cls(*(float(value) for value in columns))


def picture_statistics(grey: Grey8) -> PictureStatistics:
    """Return the statistics of a grey picture of at least 96 x 96.

    Raises
    ------
    ShapeError
        If it is no such picture.
    """
    if grey.ndim != 2 or grey.dtype != np.uint8 or min(grey.shape) < _SMALLEST_PX:
        raise ShapeError(f"statistics need a grey picture of 96 x 96 at least, not {grey.shape} {grey.dtype}")
    megapixels = grey.size / 1e6
    corners: Any = cv2.goodFeaturesToTrack(grey, 100_000, 0.01, 5)
    return PictureStatistics(
        std=float(grey.std()),
        slope=spectral_slope(grey),
        sift=len(cv2.SIFT.create().detect(grey)) / megapixels,
        corners=(0 if corners is None else len(corners)) / megapixels,
        edges=float((cv2.Canny(grey, 80, 160) > 0).mean()),
        distinct=_distinctiveness(grey),
    )


def photo_statistics(path: Path, longest_px: int | None = None) -> PictureStatistics:
    """Return the mean statistics of four windows of 512 x 480 of a photograph, or of all of a smaller one.

    Parameters
    ----------
    path : Path
        Any picture that OpenCV reads.
    longest_px : int or None
        Its longer side is first reduced to this; None: as it is [px].

    Raises
    ------
    ConfigError
        If it cannot be read, or is smaller than 96 x 96.
    """
    grey = read_grey(path)
    if longest_px is not None and max(grey.shape) > longest_px:
        scale = longest_px / max(grey.shape)
        grey = np.asarray(cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
    if min(grey.shape) < _SMALLEST_PX:
        raise ConfigError(
            f"{path}: statistics need a picture of 96 x 96 at least, not {grey.shape[1]} x {grey.shape[0]}"
        )
    height, width = min(grey.shape[0], _WINDOW_PX[1]), min(grey.shape[1], _WINDOW_PX[0])
    rows, cols = (0, grey.shape[0] - height), (0, grey.shape[1] - width)
    windows = [grey[row : row + height, col : col + width] for row in rows for col in cols]
    return PictureStatistics.mean([picture_statistics(np.ascontiguousarray(window)) for window in windows])


def spectral_slope(grey: AnyArray) -> float:
    """Return the negative exponent of the power spectrum, averaged over windows and directions."""
    n = min(_LARGE_PX, *grey.shape)
    window = np.outer(np.hanning(n), np.hanning(n))
    power = np.zeros((n, n))
    for row in range(0, grey.shape[0] - n + 1, n // 2):
        for col in range(0, grey.shape[1] - n + 1, n // 2):
            part = grey[row : row + n, col : col + n].astype(np.float64)
            power += np.abs(np.fft.fft2((part - part.mean()) * window)) ** 2
    frequency = np.fft.fftfreq(n, 1.0 / n)
    radius = np.rint(np.hypot(frequency[:, None], frequency[None, :])).astype(int)
    rings = np.bincount(radius.ravel(), power.ravel()) / np.bincount(radius.ravel())
    first, last = (edge * n / _LARGE_PX for edge in _SPECTRUM_BAND)
    band = np.arange(math.ceil(first), math.floor(last) + 1)
    return float(-np.polyfit(np.log(band), np.log(np.maximum(rings[band], 1e-9)), 1)[0])


def _distinctiveness(grey: Grey8) -> float:
    patch_px, reach_px = (44, 32) if min(grey.shape) >= _LARGE_PX else (22, 16)
    rng = np.random.default_rng(0)
    picture = grey.astype(np.float32)
    noisy = picture + rng.normal(0.0, 2.0, grey.shape).astype(np.float32)
    ratios = []
    for _ in range(_N_PATCHES):
        row = int(rng.integers(reach_px, grey.shape[0] - reach_px - patch_px))
        col = int(rng.integers(reach_px, grey.shape[1] - reach_px - patch_px))
        patch = noisy[row : row + patch_px, col : col + patch_px]
        last = reach_px + patch_px
        around = picture[row - reach_px : row + last, col - reach_px : col + last]
        squared = np.maximum(cv2.matchTemplate(around, patch, cv2.TM_SQDIFF), 1e-6)
        best = squared[reach_px, reach_px]
        squared[reach_px - 2 : reach_px + 3, reach_px - 2 : reach_px + 3] = np.inf
        ratios.append(float(np.sqrt(squared.min() / best)))
    return float(np.median(ratios))
