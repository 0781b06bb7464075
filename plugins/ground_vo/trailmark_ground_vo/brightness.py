"""The picture in even light: every pixel relative to how bright its surroundings are.

Lamps flicker, shadows wander, lenses darken towards the corners. A pixel of the ground then has another grey level in
each picture, but hardly another ratio to its surroundings. The brightness of the surroundings is taken from the
picture itself, at a sixteenth of the resolution, so that nothing has to be learned or forgotten.
"""

from __future__ import annotations

import cv2
import numpy as np

from trailmark.arrays import Grey8
from trailmark_ground_vo.filters import GAIN_ONE, cell_means, flatten

__all__ = ["EVEN_LEVEL", "even_brightness"]

#: Grey level of a pixel that is as bright as its surroundings.
EVEN_LEVEL = 128

#: Side of the cells in which the surroundings are looked at, at most and at least [px], and how many of them lie across
#: a smaller picture: light, such as the bands of lamps on mains, is as wide as the picture, not as so many pixels.
_CELL_PX, _LEAST_CELL_PX, _CELLS_ACROSS = 16, 4, 30

#: Width of the surroundings: of a median, and standard deviation of a Gauss filter [cells].
_MEDIAN_CELLS, _AROUND_CELLS = 3, 2.0

#: Width of a median of what that leaves of the light: what bends only here is a mark or a drop [cells].
_BEND_CELLS = 5

#: Cells that differ more than this from their surroundings are lit differently: only so much of it is ground [1].
_MOST_DIFFERENT = 0.1

#: The largest gain: what is darker stays dark, or a black picture would be nothing but noise.
_MOST_GAIN = 8.0


def even_brightness(image: Grey8) -> Grey8:
    """Return `EVEN_LEVEL` times the picture over the brightness around each pixel, (H, W) uint8."""
    shorter = min(image.shape)
    side = min(shorter, max(_LEAST_CELL_PX, min(_CELL_PX, shorter // _CELLS_ACROSS)))
    cells = cv2.medianBlur(cell_means(image, side), _MEDIAN_CELLS).astype(np.float32)  # no drop, but a shadow's edge
    around = np.asarray(cv2.GaussianBlur(cells, (0, 0), _AROUND_CELLS), np.float32)
    # a filter flattens the bends of the light; what it leaves of them is filtered and added (Tukey's twicing)
    around += cv2.GaussianBlur(cv2.medianBlur(cells - around, _BEND_CELLS), (0, 0), _AROUND_CELLS)
    excess = cells - around
    around += excess - np.clip(excess, -_MOST_DIFFERENT * around, _MOST_DIFFERENT * around)
    gain = GAIN_ONE * np.minimum(np.float32(_MOST_GAIN), EVEN_LEVEL / np.maximum(around, np.float32(1.0)))
    size = (image.shape[1], image.shape[0])
    return flatten(image, np.asarray(cv2.resize((gain + 0.5).astype(np.uint16), size), np.uint16))
