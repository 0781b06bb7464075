"""Which pixels of the patches of a path do not move with the ground: marks on the lens, or what covers it.

All patches are cut from the middle of the picture. What is fixed to the lens looks the same at the same pixel of most
of them; ground does so by chance alone. It has to be left out of the search: seen again it fits where the picture
shows it, and not where the ground lies.
"""

from __future__ import annotations

import cv2
import numpy as np

from trailmark.arrays import Bools, Floats, Grey8

__all__ = ["fixed_pixels"]

#: Levels that are the same: half a standard deviation of the ground.
_SAME_LEVELS = 15

#: Patches along the way that are compared with one another; fewer than the second say nothing.
_WINDOW, _LEAST_PATCHES = 48, 12

#: A pixel is fixed where so large a share of the others has its level, and more than by chance, by so many standard
#: deviations of chance.
_LEAST_SHARE, _SIGMAS = 0.3, 5.0

#: A patch of which more is fixed shows what covers the lens; chance hides the rest of it.
_MOST_FIXED = 0.4

_OPEN, _RIM = np.ones((2, 2), np.uint8), np.ones((3, 3), np.uint8)


def fixed_pixels(patches: Grey8) -> Bools:
    """Return which pixels are fixed to the lens, (N, S, S).

    Parameters
    ----------
    patches : (N, S, S) uint8
        Levelled patches in the order of the way.
    """
    fixed = np.zeros(patches.shape, np.bool_)
    if len(patches) < _LEAST_PATCHES:
        return fixed
    for first in range(0, len(patches), _WINDOW // 2):
        begin = max(0, min(first - _WINDOW // 4, len(patches) - _WINDOW))
        window = patches[begin : begin + _WINDOW]
        chance, n_others, around = _chances(window), len(window) - 1, window.astype(np.int16)
        for n in range(first, min(first + _WINDOW // 2, len(patches))):
            n_same = np.count_nonzero(np.abs(around - patches[n]) <= _SAME_LEVELS, axis=0) - 1
            expected = n_others * chance[patches[n]]
            more = n_same - expected > _SIGMAS * np.sqrt(expected * (1.0 - chance[patches[n]]))
            more &= n_same >= _LEAST_SHARE * n_others
            # single pixels of the ground are the same by chance, and the rim of a mark is half ground
            marks = cv2.dilate(cv2.morphologyEx(more.astype(np.uint8), cv2.MORPH_OPEN, _OPEN), _RIM)
            fixed[n] = True if marks.mean() > _MOST_FIXED else marks
    return fixed


def _chances(patches: Grey8) -> Floats:
    """Return the share of all pixels that have about a level, for each of the 256 levels."""
    below = np.concatenate([[0], np.cumsum(np.bincount(patches.ravel(), minlength=256))])
    level = np.arange(256)
    high, low = np.minimum(level + _SAME_LEVELS + 1, 256), np.maximum(level - _SAME_LEVELS, 0)
    return np.asarray((below[high] - below[low]) / below[-1], np.float64)
