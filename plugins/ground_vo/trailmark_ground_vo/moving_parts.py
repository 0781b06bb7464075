"""Whether parts of a picture move while most of it stands still: ground beside a sticker that covers the lens.

Most of the picture holds the match, be it a sticker or ground at rest, and outvotes the rest. But a robot that stands
does not make parts of the picture change time and again. What stands leaves nothing but noise in the difference of two
pictures, and the quietest parts tell how much that is. What has moved leaves more, and what resembles its own negative,
shifted; or it fills parts as texture does, and specks and glints do not.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from trailmark.arrays import Bools, Float32s, Floats
from trailmark_ground_vo.moved_texture import correlation

__all__ = ["MovingParts", "moving_parts"]

#: Parts across the picture and down.
_PARTS = (8, 6)

#: Parts that are quieter than the others say what noise is; what compression leaves comes and goes [grey levels].
_QUIET, _LEAST_NOISE = 0.35, 1.0

#: Mean absolute deviation to standard deviation of a normal distribution.
_SIGMA_OVER_MEAN = 1.25

#: Differences are clipped at so many times the noise: single marks have no more say than the ground.
_CLIP_SIGMAS = 4.0

#: Power of a part that changes, over that of noise: where neighbours resemble each other by so much, and where not.
_LEAST_POWER, _LEAST_GRAIN, _LEAST_POWER_ANY = 2.2, 0.15, 4.0

#: Share of a part that is beyond so many times the noise where it is full of texture.
_FILLED, _BEYOND_SIGMAS = 0.3, 2.0

#: Parts that change at least: a lamp that blinks somewhere is no ground.
_LEAST_PARTS = 3

#: Share of the parts that change when no light, nor anything that passes by, explains it.
_MOST = 0.5

#: Least resemblance to the own negative, and over the standard error of that of noise: hundreds of shifts are tried.
_LEAST_RESEMBLANCE, _LEAST_SIGMAS = 0.12, 5.0

#: Share of the cells that are compared at a shift, of those at none.
_LEAST_OVERLAP = 0.3


class MovingParts(NamedTuple):
    """What the parts of a picture say.

    Attributes
    ----------
    changes : bool
        Whether some differ by more than noise.
    has_moved : bool
        Whether they differ as texture does that has moved.
    """

    changes: bool
    has_moved: bool


def moving_parts(difference: Float32s, is_asked: Bools) -> MovingParts:
    """Return what parts say of the difference of two pictures, most of which stands still.

    Parameters
    ----------
    difference : (H, W) float32
        Of `moved_texture.texture_of`.
    is_asked : (h, w) bool
        Shifts that are looked for, as in `correlation`.
    """
    means = _means(np.abs(difference)).ravel()
    n_quiet = int(_QUIET * len(means))
    noise = max(_LEAST_NOISE, _SIGMA_OVER_MEAN * float(np.partition(means, n_quiet)[n_quiet]))
    clipped = np.clip(difference, -_CLIP_SIGMAS * noise, _CLIP_SIGMAS * noise)
    power = _means(clipped * clipped)
    has_power = power > _LEAST_POWER * noise * noise
    if np.count_nonzero(has_power) < _LEAST_PARTS:
        return MovingParts(False, False)
    products = _means(clipped[:, 1:] * clipped[:, :-1]) + _means(clipped[1:] * clipped[:-1])
    is_grainy = products > 2.0 * _LEAST_GRAIN * power
    changes = has_power & (is_grainy | (power > _LEAST_POWER_ANY * noise * noise))
    if np.count_nonzero(changes) < _LEAST_PARTS:
        return MovingParts(False, False)
    if np.count_nonzero(changes & is_grainy) >= _MOST * changes.size:
        return MovingParts(True, True)
    is_beyond = (np.abs(clipped) > _BEYOND_SIGMAS * noise).astype(np.float32)
    is_full = changes & is_grainy & (_means(is_beyond) > _FILLED)
    has_moved = int(np.count_nonzero(is_full)) >= _LEAST_PARTS or _resembles_negative(clipped, changes, is_asked)
    return MovingParts(True, has_moved)


def _means(picture: Float32s) -> Floats:
    """Return the mean of each part, (6, 8) float64."""
    return np.asarray(cv2.resize(picture, _PARTS, interpolation=cv2.INTER_AREA), np.float64)


def _resembles_negative(difference: Float32s, changes: Bools, is_asked: Bools) -> bool:
    """Return whether the parts that change resemble their own negative after a shift."""
    height, width = difference.shape
    wide = cv2.resize(changes.astype(np.float32), (width, height), interpolation=cv2.INTER_NEAREST)
    mask, shape = np.asarray(wide, np.float32), (is_asked.shape[0], is_asked.shape[1])
    overlap, products = correlation(mask, shape), correlation(difference * mask, shape)
    is_compared = is_asked & (overlap > _LEAST_OVERLAP * overlap[0, 0])
    if not is_compared.any():
        return False
    least = float((products[is_compared] / overlap[is_compared]).min() * overlap[0, 0] / products[0, 0])
    return least < -max(_LEAST_RESEMBLANCE, _LEAST_SIGMAS / math.sqrt(float(overlap[0, 0])))
