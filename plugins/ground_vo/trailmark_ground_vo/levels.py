"""The half-size picture that patches are registered from and searched in.

Raw intensities, as in the paper, lose a patch as soon as the light changes: on low-contrast wood a gain of 0.94 with
a little shading makes 88 % of right matches fail the consensus. The picture is therefore high-passed and brought to
one contrast, and what stands far out of it (dirt) is left out of the search.

The surroundings are a median: a mean would lay a halo around each mark on the lens, glint and edge of a shadow, and a
patch would be found where its halos are.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.arrays import Bools, Float32s, Grey8
from trailmark.kernels import kernel

__all__ = ["LEFT_OUT", "LEVEL_ZERO", "foreign_pixels", "half_picture", "levelled", "seven_bits", "tamed"]


#: Level of a pixel that is as bright as its surroundings, and levels per standard deviation of the picture.
LEVEL_ZERO = 128
_LEVELS_PER_SIGMA = 30.0

#: Level of a pixel that is to count as dirt.
LEFT_OUT = 0

#: Surroundings: the median of a square of this side in the quarter-size picture, evened out by a box, because medians
#: jump [quarter-size px]; and then what another box, twice over, still finds around a pixel [half-size px].
_MEDIAN_PX, _EVEN_PX, _BOX_PX = 15, 5, 19

#: Pixels this many standard deviations away from their surroundings are dirt, or might be.
_DIRT_SIGMAS = 4.0

#: Differences from the median that enter the mean, in standard deviations: a spot is not to spoil its neighbours.
_CLIP_SIGMAS = 2.0

#: Standard deviation over median absolute deviation of a normal distribution.
_SIGMA_OVER_MEDIAN = 1.4826

#: Least standard deviation: a picture without texture is not to be blown up to one with [grey levels].
_LEAST_SIGMA = 0.5


def half_picture(image: Grey8) -> Grey8:
    """Return the picture at half the resolution: means of 2 x 2 pixels."""
    height, width = image.shape
    return np.asarray(cv2.resize(image, (width // 2, height // 2), interpolation=cv2.INTER_AREA), np.uint8)


def levelled(half: Grey8) -> Grey8:
    """Return the high-passed picture at one contrast: `LEVEL_ZERO` + 30 levels per standard deviation, uint8."""

    def smoothed(picture: Float32s) -> Float32s:
        box = (_BOX_PX, _BOX_PX)
        return np.asarray(cv2.blur(cv2.blur(picture, box), box), np.float32)

    grey = half.astype(np.float32)
    median = cv2.medianBlur(half_picture(half), _MEDIAN_PX).astype(np.float32)
    even = cv2.blur(median, (_EVEN_PX, _EVEN_PX))
    around = np.asarray(cv2.resize(even, half.shape[::-1], interpolation=cv2.INTER_LINEAR), np.float32)
    limit = _CLIP_SIGMAS * _robust_sigma(grey - around)
    around = around + smoothed(np.clip(grey - around, -limit, limit))
    difference = grey - around
    scale = np.float32(_LEVELS_PER_SIGMA / max(_LEAST_SIGMA, _robust_sigma(difference)))
    return np.asarray(np.clip(LEVEL_ZERO + scale * difference + 0.5, 0, 255), np.uint8)


def _robust_sigma(difference: Float32s) -> float:
    sparse = np.abs(difference[::4, ::4]).ravel()
    middle = len(sparse) // 2
    return _SIGMA_OVER_MEDIAN * float(np.partition(sparse, middle)[middle])


def seven_bits(levels: Grey8, is_levelled: bool) -> npt.NDArray[np.int8]:
    """Return what the search compares, int8 from 0 to 127.

    Parameters
    ----------
    levels : (H, W) uint8
        Of `levelled`: one standard deviation spans the whole range and dirt is neutral, so that no pixel counts much
        more than another. Of `half_picture`: the upper seven bits.
    is_levelled : bool
        Which of the two.
    """
    return _look_up(levels, _SEARCHED if is_levelled else _UPPER_BITS).view(np.int8)


def foreign_pixels(levels: Grey8) -> Bools:
    """Return which pixels of a levelled picture are dirt, or might be."""
    return np.asarray(np.abs(levels.astype(np.int16) - LEVEL_ZERO) > _DIRT_SIGMAS * _LEVELS_PER_SIGMA)


def tamed(levels: Grey8) -> Grey8:
    """Return what the refinement compares of a levelled picture: at most two standard deviations, dirt neutral."""
    return _look_up(levels, _REFINED)


@kernel
def _look_up(levels: Grey8, table: Grey8) -> Grey8:
    out = np.empty(levels.shape, np.uint8)
    flat_in, flat_out = levels.reshape(-1), out.reshape(-1)
    for n in range(flat_in.size):
        flat_out[n] = table[flat_in[n]]
    return out


def _table(zero: float, per_sigma: float, limit: float) -> Grey8:
    sigmas = (np.arange(256) - LEVEL_ZERO) / _LEVELS_PER_SIGMA
    squeezed = zero + np.clip(per_sigma * sigmas, -limit, limit)
    return np.rint(np.where(np.abs(sigmas) > _DIRT_SIGMAS, zero, squeezed)).astype(np.uint8)


_SEARCHED = _table(64.0, 63.0, 63.0)
_REFINED = _table(LEVEL_ZERO, _LEVELS_PER_SIGMA, 2.0 * _LEVELS_PER_SIGMA)
_UPPER_BITS = (np.arange(256) >> 1).astype(np.uint8)
