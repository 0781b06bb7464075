"""Which pixels do not move with the ground: dirt, drops and scratches on the lens, reflections of a lamp.

Where the ground moves, a pixel that looks as it did at the same place in the picture before, though the ground that
came there looks otherwise, is fixed to the lens. Ground does so now and then, marks do so every time.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from trailmark.arrays import Bools, Float32s, Grey8
from trailmark.kernels import kernel
from trailmark_ground_vo.closed_places import closed_by
from trailmark_ground_vo.motion import ImageMotion

__all__ = ["LensMarkEvidence"]

#: One row and column in so many is looked at.
_EVERY = 2

#: Differences that are seen, and that are none [standard deviations of the difference of two pictures].
_SEEN_SIGMAS, _SAME_SIGMAS = 5.0, 3.0

#: Least of both [grey levels].
_LEAST_SEEN, _LEAST_SAME = 4.0, 2.0

#: The ground shines through the veil of a reflection, which stands where a pixel changes by this share at most of what
#: a motion would have changed, and up to so much [grey levels]: the ground beside a mark does so, too, now and then.
_VEILED_SHARE, _MOST_VEILED = 0.5, 12.0

#: What is kept of older evidence in each picture.
_KEPT = 0.97

#: Pictures in which a mark has stood still at least, and their share of those in which it could be told.
_LEAST_FIXED, _LEAST_SHARE = 4.0, 0.75

#: Pictures between two looks at the evidence.
_INTERVAL_FRAMES = 4

#: Shift that tells marks and ground apart [px].
_LEAST_SHIFT_PX = 2.0

#: A mask of more than this is none: the ground stands still, or is not seen [share of the picture].
_MOST_MASKED = 0.35

#: Marks are widened by this many cells; beyond, pixels fade in over so many more.
_WIDENED, _FADING = 1, 1


class LensMarkEvidence:
    """Gathers evidence from pairs of pictures.

    Parameters
    ----------
    size : (int, int)
        Width and height of the pictures [px].
    aspect : float
        Metres per pixel along v over those along u.
    """

    def __init__(self, size: tuple[int, int], aspect: float) -> None:
        self._size = size
        self._centre = ((size[0] - 1) / 2.0, (size[1] - 1) / 2.0)
        self._aspect = aspect
        shape = (len(range(0, size[1], _EVERY)), len(range(0, size[0], _EVERY)))
        self._seen, self._fixed, self._veiled = (np.zeros(shape, np.float32) for _ in range(3))
        self._n_frames = 0
        self._mask = np.zeros(shape, np.bool_)

    def add(self, before: Grey8, now: Grey8, motion: ImageMotion | None, sigma: float) -> None:
        """Compare two pictures of even light.

        Parameters
        ----------
        before, now : (H, W) uint8
            The pictures.
        motion : ImageMotion or None
            How the content moved; None where that is not known, but that it did.
        sigma : float
            Standard deviation of the difference of two pictures of the same [grey levels].
        """
        if motion is not None and math.hypot(motion.u, motion.v) < _LEAST_SHIFT_PX:
            return
        seen, same = max(_LEAST_SEEN, _SEEN_SIGMAS * sigma), max(_LEAST_SAME, _SAME_SIGMAS * sigma)
        moved = (0.0, 0.0, 0.0) if motion is None else (motion.u, motion.v, motion.turn_rad)
        levels = (np.float32(seen), np.float32(same))
        counts = self._seen, self._fixed, self._veiled
        _add_evidence(before, now, self._centre, moved, self._aspect, motion is None, levels, *counts)
        self._n_frames += 1

    @property
    def are_known(self) -> bool:
        """Whether something is fixed to the lens."""
        return bool(self._mask.any())

    def new_weights(self) -> Grey8 | None:
        """Return how much each pixel counts, (H, W) uint8 from 0 to 255, when that has changed."""
        if self._n_frames < _INTERVAL_FRAMES:
            return None
        self._n_frames = 0
        mask = self._standing(self._veiled)
        weights = _weights_of(mask, self._size)
        if closed_by(weights) is None:  # many small marks, and the ground between them
            mask = self._standing(self._fixed)
            weights = _weights_of(mask, self._size)
        if mask.mean() > _MOST_MASKED or np.count_nonzero(mask != self._mask) <= 0.001 * mask.size:
            return None
        self._mask = mask
        return weights

    def _standing(self, stood: Float32s) -> Bools:
        """Return where so much has stood still that it is no chance."""
        mask = (stood >= _LEAST_FIXED) & (stood >= _LEAST_SHARE * self._seen)
        # single pixels of the ground stand still by chance
        opened = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
        return np.asarray(opened, np.bool_)


def _weights_of(mask: Bools, size: tuple[int, int]) -> Grey8:
    """Return how much each pixel counts beside marks, (H, W) uint8."""
    wide = cv2.dilate(mask.astype(np.uint8), np.ones((2 * _WIDENED + 1, 2 * _WIDENED + 1), np.uint8))
    side = 2 * _FADING + 1
    faded = cv2.blur(cv2.dilate(255 * wide, np.ones((side, side), np.uint8)), (side, side))
    return np.asarray(255 - cv2.resize(faded, size, interpolation=cv2.INTER_LINEAR), np.uint8)


@kernel
def _add_evidence(
    before: Grey8,
    now: Grey8,
    centre: tuple[float, float],
    motion: tuple[float, float, float],
    aspect: float,
    is_unknown: bool,
    levels: tuple[np.float32, np.float32],
    seen: Float32s,
    fixed: Float32s,
    veiled: Float32s,
) -> None:
    """Count, for every cell, where mark and ground differ, and where it stood still then.

    Parameters
    ----------
    before, now : (H, W) uint8
        The pictures.
    centre, motion, aspect
        As in `texture.residuals`.
    is_unknown : bool
        The motion is not known: a mark is what differs from even light then.
    levels : (float32, float32)
        Differences that are seen from, and that are none up to.
    seen, fixed, veiled : (H / 2, W / 2) float32
        Counts so far; changed.
    """
    height, width = now.shape
    cos, sin = np.float32(math.cos(motion[2])), math.sin(motion[2])
    across, down = np.float32(sin * aspect), np.float32(sin / aspect)
    kept, half = np.float32(_KEPT), np.float32(0.5)
    share, most = np.float32(_VEILED_SHARE), np.float32(_MOST_VEILED)
    for row in range(seen.shape[0]):
        y = row * _EVERY
        dy = np.float32(y - centre[1] - motion[1])
        for column in range(seen.shape[1]):
            x = column * _EVERY
            dx = np.float32(x - centre[0] - motion[0])
            level = np.float32(now[y, x])
            there = np.float32(128.0)
            if not is_unknown:  # the inverse of a small turn about the centre
                u = int(cos * dx - across * dy + np.float32(centre[0]) + half)
                v = int(cos * dy + down * dx + np.float32(centre[1]) + half)
                if u < 0 or v < 0 or u >= width or v >= height:
                    continue
                there = np.float32(before[v, u])
            seen[row, column] *= kept
            fixed[row, column] *= kept
            veiled[row, column] *= kept
            difference, change = abs(level - there), abs(level - np.float32(before[y, x]))
            if difference > levels[0]:
                seen[row, column] += np.float32(1.0)
                fixed[row, column] += np.float32(change <= levels[1])
                veiled[row, column] += np.float32(change <= max(levels[1], min(most, share * difference)))
