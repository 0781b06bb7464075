"""Video whose odd and even lines are of two instants: one of them is looked at.

Where the content moves, such a picture is combed: a line resembles the one after the next more than the next. No ground
does that, and noise resembles neither. Half the lines are lost then, but what is left was seen at one time.
"""

from __future__ import annotations

import logging
import math
from collections import deque

import cv2
import numpy as np

from trailmark.arrays import Grey8

__all__ = ["FieldReader", "is_combed"]

logger = logging.getLogger(__name__)

#: One row in so many is compared with the two below it.
_EVERY = 4

#: Differences to the next line over those to the one after it, of a combed picture, and standard errors beyond 1. Seven
#: floors under five conditions said at most 1.017, between lines of a field that moved 2 px more than the other 1.04.
_COMBED, _STANDARD_ERRORS = 1.05, 6.0

#: Combed pictures among the latest ones after which all are taken so: where the robot is slow it cannot be seen.
#: The latest ones are a second of video: an interlaced camera shows three in it as soon as the robot is fast, while
#: strays (torn pictures) that come minutes apart do not add up over hours. Each combed picture is read as one anyway.
_MOST_COMBED, _LATEST = 3, 30


class FieldReader:
    """Reads interlaced pictures as ones of one instant, and others as they are.

    Attributes
    ----------
    is_interlaced : bool
        Whether the camera has been found to interlace.
    """

    def __init__(self) -> None:
        self.is_interlaced = False
        self._were_combed: deque[bool] = deque(maxlen=_LATEST)

    def read(self, image: Grey8) -> Grey8:
        """Return a picture of the even lines where it is combed, (H, W) uint8; `image` may be changed."""
        if not self.is_interlaced:
            self._were_combed.append(is_combed(image))
            if not self._were_combed[-1]:
                return image
            self.is_interlaced = sum(self._were_combed) >= _MOST_COMBED
            if self.is_interlaced:
                logger.warning("the video is interlaced: only every second line is looked at; better switch it off")
        below = image[2::2]
        lines = image[1 : 2 * len(below) : 2]
        cv2.addWeighted(np.ascontiguousarray(image[: 2 * len(below) : 2]), 0.5, below, 0.5, 0.0, lines)
        if len(image) % 2 == 0:
            image[-1] = image[-2]
        return image


def is_combed(image: Grey8) -> bool:
    """Return whether odd and even lines show the content at two places."""
    n = (len(image) - 2) // _EVERY
    if n < 1:
        return False
    lines, after, then = (image[first : first + n * _EVERY : _EVERY] for first in range(3))
    to_next, to_second = cv2.norm(lines, after, cv2.NORM_L1), cv2.norm(lines, then, cv2.NORM_L1)
    return to_next > max(_COMBED, 1.0 + _STANDARD_ERRORS / math.sqrt(lines.size)) * to_second
