"""Which patches of a path, or quarters of them, show what covers the lens in place of the ground.

`fixed_pixels` asks each pixel and needs many patches for that. Here many pixels are asked, and two or three patches are
enough: neighbours along the way show other ground, so that nothing makes them agree best where both are laid one upon
the other without a shift, unless it is fixed to the lens. A floor that repeats at the spacing of the patches agrees at
the shifts by which the robot missed that spacing; where it missed it by less than a pixel nobody can tell floor and
cover apart, and the patch is no place.
"""

from __future__ import annotations

import cv2
import numpy as np

from trailmark.arrays import Bools, Float32s, Floats, Grey8
from trailmark_ground_vo.levels import tamed

__all__ = ["covered_pixels"]

#: Patches along the way on either side with which one is compared.
_NEIGHBOURS = 3

#: Shifts that must agree less than none, either way. Patches of which the ground moved by less than twice as much on
#: the picture show the same ground [half-size px].
_SHIFT_PX = 3

#: Least correlation of what is the same. Of 2,394 pairs of patches of seven photographs that agreed best without a
#: shift none reached 0.35; of their quarters 2 in 1,000 reached 0.4, which is why a quarter needs two neighbours.
_LEAST_CORRELATION = 0.4
_LEAST_OF_WHOLE, _LEAST_OF_QUARTER = 1, 2

#: Smaller parts agree by chance [half-size px].
_LEAST_SIDE_PX = 20

#: Standard deviation below which a part shows nothing [levels].
_LEAST_CONTRAST = 1.0


def covered_pixels(patches: Grey8, places_px: Floats) -> Bools:
    """Return which pixels belong to a patch or a quarter of one that shows a cover, (N, S, S).

    Parameters
    ----------
    patches : (N, S, S) uint8
        Levelled patches in the order of the way, without what is known to be fixed.
    places_px : (N, 2) float64
        Where they lie on the ground, in pixels of the half-size picture.
    """
    smooth = [cv2.blur(tamed(patch), (3, 3)).astype(np.float32) for patch in patches]
    covered, half = np.zeros(patches.shape, np.bool_), patches.shape[1] // 2
    begins = (slice(None, half), slice(half, None))
    parts = [((slice(None), slice(None)), _LEAST_OF_WHOLE)]
    parts += [((rows, columns), _LEAST_OF_QUARTER) for rows in begins for columns in begins]
    for part, least in parts:
        covered[_are_fixed([one[part] for one in smooth], places_px, least), *part] = True
    return covered


def _are_fixed(pictures: list[Float32s], places_px: Floats, least: int) -> Bools:
    """Return which pictures agree with so many neighbours, and more without a shift than with one, (N,)."""
    n_alike, unmoved, moved = (np.zeros(len(pictures)) for _ in range(3))
    for lag in range(1, _NEIGHBOURS + 1):
        for n in range(len(pictures) - lag):
            if np.hypot(*(places_px[n] - places_px[n + lag])) <= 2 * _SHIFT_PX:
                continue
            correlations = _correlations(pictures[n], pictures[n + lag])
            best, pair = correlations.max(), [n, n + lag]
            if best < _LEAST_CORRELATION:
                continue
            if correlations[_SHIFT_PX, _SHIFT_PX] == best:
                n_alike[pair] += 1
                unmoved[pair] += best
            else:
                moved[pair] += best
    return np.asarray((n_alike >= least) & (unmoved > moved))


def _correlations(one: Float32s, other: Float32s) -> Float32s:
    """Return the correlation of the middle of one with the other at each shift; 0 where there is nothing to see."""
    side, middle = 2 * _SHIFT_PX + 1, one[_SHIFT_PX:-_SHIFT_PX, _SHIFT_PX:-_SHIFT_PX]
    if min(one.shape) < _LEAST_SIDE_PX or min(middle.std(), other.std()) < _LEAST_CONTRAST:
        return np.zeros((side, side), np.float32)
    return np.asarray(cv2.matchTemplate(other, middle, cv2.TM_CCOEFF_NORMED), np.float32)
