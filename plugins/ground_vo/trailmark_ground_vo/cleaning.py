"""The picture as tracking reads it: in even light, and neutral where something other than the ground is seen."""

from __future__ import annotations

import cv2
import numpy as np

from trailmark.arrays import Grey8
from trailmark_ground_vo.brightness import EVEN_LEVEL, even_brightness

__all__ = ["contrast_of", "in_even_light"]

#: Pixels this many standard deviations from their surroundings are drops, dirt or glints. Of ten floors at most 1.2 %
#: of the pixels are (grooves of planks), of eight less than 0.4 %.
_FOREIGN_SIGMAS = 6.5

#: Least standard deviation of a picture: plain ground is not full of foreign things [grey levels].
_LEAST_SIGMA = 3.0

#: One row and column in so many tells the standard deviation of the picture.
_EVERY = 8

#: Standard deviation over median absolute deviation of a normal distribution.
_SIGMA_OVER_MEDIAN = 1.4826

#: Share of the picture that is foreign, rim and all, from which on it makes its surroundings darker.
_MUCH = 0.005

#: A foreign thing has a rim that is half ground: it is widened by this to all sides [px].
_RIM_PX = 2

_RIM = np.ones((2 * _RIM_PX + 1, 2 * _RIM_PX + 1), np.uint8)


def in_even_light(image: Grey8) -> tuple[Grey8, Grey8]:
    """Return a picture in even light twice, (H, W) uint8: with `EVEN_LEVEL` where it is foreign, and as it is there.

    The first is for tracking; the second shows what of the foreign things stands still, and is a mark on the lens.
    """
    even = even_brightness(image)
    foreign = _foreign(even)
    if foreign is not None and cv2.countNonZero(foreign) > _MUCH * foreign.size:
        even = even_brightness(image, foreign)  # what is foreign is no light either
        again = _foreign(even)
        foreign = foreign if again is None else np.bitwise_or(foreign, again)
    if foreign is None:
        return even, even
    cleaned = even.copy()
    cv2.copyTo(np.full_like(even, EVEN_LEVEL), foreign, cleaned)
    return cleaned, even


def _foreign(even: Grey8) -> Grey8 | None:
    """Return 255 for foreign pixels and their rims, (H, W) uint8; None where there is none."""
    reach = min(126.0, _FOREIGN_SIGMAS * max(_LEAST_SIGMA, contrast_of(even)))
    foreign = np.asarray(cv2.bitwise_not(cv2.inRange(even, EVEN_LEVEL - reach, EVEN_LEVEL + reach)), np.uint8)
    return np.asarray(cv2.dilate(foreign, _RIM), np.uint8) if cv2.countNonZero(foreign) else None


def contrast_of(even: Grey8) -> float:
    """Return the robust standard deviation of a picture in even light [grey levels]."""
    sparse = np.abs(even[::_EVERY, ::_EVERY].astype(np.int16) - EVEN_LEVEL).ravel()
    return _SIGMA_OVER_MEDIAN * float(np.partition(sparse, len(sparse) // 2)[len(sparse) // 2])
