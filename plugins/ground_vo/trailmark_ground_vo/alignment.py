"""Refining the place of a patch that has been found, with gain and offset."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Bools, Float32s, Floats, Grey16
from trailmark_ground_vo.filters import SMOOTH_SCALE
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.refine import refine
from trailmark_ground_vo.texture import SLOPE_U, SLOPE_V, VALUE, Texture, X, Y, residuals

__all__ = ["AlignedPatch", "SmoothPicture", "align_patch"]


#: Rim of a patch whose smoothing and slopes would need pixels beyond it [px].
_RIM_PX = 3

#: Residual beyond which a pixel counts less, in levels: one standard deviation of a levelled picture.
_HUBER = 30.0 * SMOOTH_SCALE

#: Pixels that a patch is aligned by at least.
_LEAST_PIXELS = 100

_MAX_ITERATIONS = 12
_ROUNDS = 3

#: Pixels whose residual is this many times the median are covered, or might be.
_MISFIT = 4.0

#: Gains between the two pictures that are believed, to either side.
_LEAST_GAIN = 0.6

#: Neighbours share what they say, through smoothing and interpolation: one pixel in this many counts (measured, so
#: that normalised squared errors on ten floors come out at one).
_SHARED = 7.0

#: Standard deviation of a residual over its median absolute value, for a normal distribution.
_SIGMA_OVER_MEDIAN = 1.4826


@dataclass(frozen=True, slots=True, eq=False)
class SmoothPicture:
    """A picture or a patch as it is compared.

    Attributes
    ----------
    values : (H, W) uint16
        Smoothed.
    is_ground : (H, W) bool
        Where dirt has no share in that.
    """

    values: Grey16
    is_ground: Bools


@dataclass(frozen=True, slots=True, eq=False)
class AlignedPatch:
    """A patch, aligned.

    Attributes
    ----------
    motion : ImageMotion
        From where it was registered, about the middle of the picture.
    information : (3, 3) float64
        Of (u, v, turn).
    correlation : float
        Of the patch with the picture there, without the tenth of the pixels that fit least.
    """

    motion: ImageMotion
    information: Floats
    correlation: float


def align_patch(
    picture: SmoothPicture,
    patch: SmoothPicture,
    middle: tuple[float, float],
    start: ImageMotion,
    aspect: float,
    groups: Bools,
) -> AlignedPatch:
    """Return the motion that makes the patch look like the picture where both show ground.

    Parameters
    ----------
    picture, patch : SmoothPicture
        (H, W) and (N, N).
    middle : (float, float)
        Middle of the picture, where the patch was registered [px].
    start : ImageMotion
        Motion to start from.
    aspect : float
        Metres per pixel along v over those along u.
    groups : (4,) bool
        Quadrants that count: upper left, upper right, lower left, lower right.

    Returns
    -------
    AlignedPatch
        Where it started, with a correlation of 0, if too few pixels show ground.
    """
    texture = _texture_of(patch, middle)
    right, low = texture[X] > middle[0], texture[Y] > middle[1]
    texture = np.ascontiguousarray(texture[:, groups[2 * low.astype(int) + right]])
    motion = (start.u, start.v, start.turn_rad)
    curvature = np.zeros((3, 3))
    for _ in range(_ROUNDS):  # gain and offset, and what does not fit, are judged anew from where the last one ended
        on_ground = _on_ground(picture.is_ground, texture, middle, motion, aspect)
        if on_ground.shape[1] < _LEAST_PIXELS:
            return AlignedPatch(start, np.zeros((3, 3)), 0.0)
        fitting = _fitting(picture.values, on_ground, middle, motion, aspect)
        motion, curvature, _ = refine(picture.values, fitting, middle, motion, aspect, _HUBER, _MAX_ITERATIONS)
    matched = _with_gain(picture.values, on_ground, middle, motion, aspect)
    differences = residuals(picture.values, matched, middle, motion, aspect)
    sigma = max(1.0, _SIGMA_OVER_MEDIAN * float(_median(np.abs(differences))))
    information = curvature / (_SHARED * sigma * sigma)
    return AlignedPatch(ImageMotion(*motion), information, _correlation(matched[VALUE], differences))


def _texture_of(patch: SmoothPicture, middle: tuple[float, float]) -> Texture:
    """Return the pixels of a patch that show ground, but for its rim."""
    side = len(patch.values)
    inner = slice(_RIM_PX, side - _RIM_PX)
    values = patch.values.astype(np.float32)
    v, u = np.mgrid[:side, :side].astype(np.float32) - np.float32((side - 1) / 2.0)
    x, y = u + middle[0], v + middle[1]
    rows = [x, y, values, *np.gradient(values)[::-1], np.ones_like(values), x, y]
    is_ground = patch.is_ground[inner, inner].ravel()
    return np.stack([row[inner, inner].ravel()[is_ground] for row in rows]).astype(np.float32)


def _on_ground(
    is_ground: Bools, texture: Texture, middle: tuple[float, float], motion: tuple[float, float, float], aspect: float
) -> Texture:
    """Return the pixels that fall on ground in the picture."""
    height, width = is_ground.shape
    cos, sin = math.cos(motion[2]), math.sin(motion[2])
    dx, dy = texture[X] - middle[0], texture[Y] - middle[1]
    u = np.rint(cos * dx + sin * aspect * dy + middle[0] + motion[0]).astype(np.intp)
    v = np.rint(cos * dy - sin / aspect * dx + middle[1] + motion[1]).astype(np.intp)
    return np.ascontiguousarray(texture[:, is_ground[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)]])


def _fitting(
    picture: Grey16, texture: Texture, middle: tuple[float, float], motion: tuple[float, float, float], aspect: float
) -> Texture:
    """Return the pixels that fit, with the gain and offset of the picture."""
    matched = _with_gain(picture, texture, middle, motion, aspect)
    sizes = np.abs(residuals(picture, matched, middle, motion, aspect))
    return np.ascontiguousarray(matched[:, sizes <= _MISFIT * _median(sizes)])


def _with_gain(
    picture: Grey16, texture: Texture, middle: tuple[float, float], motion: tuple[float, float, float], aspect: float
) -> Texture:
    expected = texture[VALUE].astype(np.float64)
    seen = residuals(picture, texture, middle, motion, aspect) + expected
    around, spread = float(np.mean(expected)), float(np.var(expected))
    gain = float(np.mean((seen - seen.mean()) * (expected - around))) / spread if spread > 0.0 else 1.0
    gain = min(max(gain, _LEAST_GAIN), 1.0 / _LEAST_GAIN)
    out = texture.copy()
    out[VALUE] = gain * (expected - around) + _median(seen - gain * (expected - around))
    out[[SLOPE_U, SLOPE_V]] *= np.float32(gain)
    return out


def _median(values: npt.NDArray[Any]) -> Any:
    """Return what `np.median` does of finite values, without its questions, which take longer than the answer."""
    middle = len(values) // 2
    if len(values) % 2:
        return np.partition(values, middle)[middle]
    below, above = np.partition(values, (middle - 1, middle))[middle - 1 : middle + 1]
    return (below + above) / values.dtype.type(2.0)


def _correlation(expected: Float32s, differences: Float32s) -> float:
    sizes = np.abs(differences)
    good = sizes <= np.quantile(sizes, 0.9)
    a = expected[good].astype(np.float64)
    b = a + differences[good]
    a, b = a - a.mean(), b - b.mean()
    scale = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / scale if scale > 0.0 else 0.0
