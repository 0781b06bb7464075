"""Whether a picture is the one before again: cameras have noise, drivers and converters of video repeat themselves.

What a driver repeats is the same bit by bit. What was encoded again on its way is nearly so; a robot that stands looks
nearly so as well, but one that was moving does not stop from one picture to the next. Dirt on the lens stands in all
pictures: what the earlier ones have in common says nothing.
"""

from __future__ import annotations

import math
from collections import deque

import cv2
import numpy as np

from trailmark.arrays import Float32s, Grey8
from trailmark_ground_vo.cadence import Cadence
from trailmark_ground_vo.motion import ImageMotion

__all__ = ["RepeatWatch"]

#: Pixels that are compared before all others are.
_EVERY = (slice(None, None, 16), slice(None, None, 16))

#: One row in so many tells how much two pictures differ.
_ROWS = 4

#: Shift of the last motion from which on a robot does not stop at once [px], and pictures for which it is not believed.
_MOVING_PX, _MOST_REPEATS = 3.0, 3

#: Most that a picture may differ from the one before, of what it differs from that one moved on, and shares of the last
#: motion after which it must not differ less: the robot has braked.
_MOST_SHARE, _SLOWER = 0.6, (0.125, 0.25, 0.5)

#: Pictures whose mean shows what is fixed to the lens: ground that moves through them is blurred.
_N_EARLIER = 8


class RepeatWatch:
    """Remembers the picture before, and what all pictures have in common."""

    def __init__(self) -> None:
        self._previous: Grey8 | None = None
        self._earlier: deque[Grey8] = deque(maxlen=_N_EARLIER)
        self._n_repeats = 0
        self._cadence = Cadence()

    def keep(self, image: Grey8) -> None:
        """Take a picture for the last one, as after a change of the flat field."""
        if self._previous is not None:
            self._earlier.append(self._previous)
        self._previous = image

    def is_same(self, image: Grey8) -> bool:
        """Return whether a picture is the one before, bit by bit."""
        before = self._previous
        if before is None or not np.array_equal(image[_EVERY], before[_EVERY]):
            return False
        return np.array_equal(image, before)

    def is_encoded_again(self, image: Grey8, last: ImageMotion | None) -> bool:
        """Return whether a picture looks like the one before, though its content was moving; a few times in a row.

        Parameters
        ----------
        image : (H, W) uint8
            The next picture.
        last : ImageMotion or None
            How the content moved into the picture before.
        """
        before = self._previous
        if before is None or last is None or not self._earlier or math.hypot(last.u, last.v) < _MOVING_PX:
            return False
        if self._n_repeats >= _MOST_REPEATS or not self._stands(before, image, last):
            self._n_repeats = 0
            return False
        self._n_repeats += 1
        return True

    def is_due(self, image: Grey8) -> bool:
        """Return whether every second picture is repeated, and this is one of those."""
        if self._previous is None or not self._cadence.is_due:
            return False
        return self._cadence.is_repeat(_difference(self._previous, image, (0, 0)))

    def add_repeat(self) -> None:
        """Take the picture that was kept last for a repeat."""
        if self._previous is not None and self._earlier:
            self._cadence.add_repeat(_difference(self._earlier[-1], self._previous, (0, 0)))

    def add(self, motion: ImageMotion | None) -> None:
        """Take how the content moved into the picture that was kept last; None where that is not known."""
        if motion is not None and self._cadence.stands(motion):
            self.add_repeat()
        elif motion is None or math.hypot(motion.u, motion.v) >= _MOVING_PX or not self._earlier:
            self._cadence.add_motion(motion, math.inf)
        else:
            assert self._previous is not None
            self._cadence.add_motion(motion, _difference(self._earlier[-1], self._previous, (0, 0)))

    def _stands(self, before: Grey8, now: Grey8, last: ImageMotion) -> bool:
        """Return whether a picture is the one before even if what is fixed to the lens, as dirt is, does not count."""
        if not _differs_less(before, now, last):
            return False
        fixed = np.sum(self._earlier, axis=0, dtype=np.uint16) / np.float32(len(self._earlier))
        return _differs_less(before - fixed, now - fixed, last)


def _differs_less(before: Grey8 | Float32s, now: Grey8 | Float32s, last: ImageMotion) -> bool:
    """Return whether two pictures differ far less as they are than with the first moved on as in the last motion."""
    still, on = _difference(before, now, (0, 0)), _difference(before, now, (round(last.u), round(last.v)))
    if still >= _MOST_SHARE * on:
        return False
    slower = [(round(share * last.u), round(share * last.v)) for share in _SLOWER]
    return all(still <= _difference(before, now, shift) for shift in slower)


def _difference(before: Grey8 | Float32s, now: Grey8 | Float32s, shift: tuple[int, int]) -> float:
    """Return the mean absolute difference of two pictures, the first moved by a shift (u, v); 0 where none is left."""
    (height, width), (u, v) = now.shape, shift
    if abs(u) >= width // 2 or abs(v) >= height // 2:
        return 0.0
    here = now[max(0, v) : height + min(0, v) : _ROWS, max(0, u) : width + min(0, u)]
    there = before[max(0, -v) : height - max(0, v) : _ROWS, max(0, -u) : width - max(0, u)]
    if here.dtype == there.dtype == np.uint8:  # the same number, in a seventh of the time
        return float(np.float32(cv2.norm(here, there, cv2.NORM_L1)) / np.float32(here.size))
    return float(np.abs(np.subtract(here, there, dtype=np.float32)).mean())
