"""Video at twice the rate of its camera: every second picture is the one before again.

A robot does not stop and go from one picture to the next, time and again. Where that has been seen, every second
picture is a repeat, at rest as well: so that the first picture in which the robot starts is known for what it is.
"""

from __future__ import annotations

import math
from collections import deque

from trailmark_ground_vo.motion import ImageMotion

__all__ = ["Cadence"]

#: Motion from which on the content has moved, and up to which it stands, of itself and of the motion before [px].
_MOVED_PX, _STANDS_PX, _STANDS_SHARE = 0.3, 0.2, 0.2

#: What a turn counts: how far it moves what lies so far from the centre [px].
_LEVER_PX = 100.0

#: What shows that the pictures are doubled: so many that moved, and that stand, in turn.
_N_SEEN = 4

#: A picture that moved differs by so many times more than one that stands, or noise alone makes it seem to move.
_MOVED_DIFFERENCE = 1.1

#: A repeat may differ from its picture so many times as much as those before did, and by so much more [grey levels].
_USUAL, _LEAST_LEVELS = 1.3, 0.1


class Cadence:
    """Watches in which pictures the content stands.

    Attributes
    ----------
    is_due : bool
        Whether the next picture is a repeat.
    """

    def __init__(self) -> None:
        self._seen: deque[tuple[bool, float]] = deque(maxlen=_N_SEEN)
        self._moved_px, self._usual = 0.0, math.inf
        self._is_doubled = self.is_due = False

    def is_repeat(self, difference: float) -> bool:
        """Return whether a picture that is due differs from the one before by as little as a repeat [grey levels]."""
        if difference <= _USUAL * self._usual + _LEAST_LEVELS:
            return True
        self._forget()
        return False

    def stands(self, motion: ImageMotion) -> bool:
        """Return whether a content stands that moved before."""
        return _size_px(motion) <= min(_STANDS_PX, _STANDS_SHARE * self._moved_px)

    def add_repeat(self, difference: float) -> None:
        """Take a picture that is the one before again, and how much they differ [grey levels]."""
        self._usual = min(self._usual, difference)
        self._add(True, difference)

    def add_motion(self, motion: ImageMotion | None, difference: float) -> None:
        """Take another picture, how the content has moved where that is known, and how much the two differ."""
        self._moved_px = 0.0 if motion is None else _size_px(motion)
        if self._moved_px < _MOVED_PX:
            self._seen.clear()
        self._add(False, difference)

    def _forget(self) -> None:
        self._seen.clear()
        self._moved_px, self._usual = 0.0, math.inf
        self._is_doubled = self.is_due = False

    def _add(self, stands: bool, difference: float) -> None:
        self._seen.append((stands, difference))
        self._is_doubled = self._is_doubled or self._alternates()
        self.is_due = self._is_doubled and not stands

    def _alternates(self) -> bool:
        if [stands for stands, _ in self._seen] != [False, True] * (_N_SEEN // 2):
            return False
        moved, stood = ([size for stands, size in self._seen if stands is kind] for kind in (False, True))
        return min(moved) > _MOVED_DIFFERENCE * max(stood)


def _size_px(motion: ImageMotion) -> float:
    return math.hypot(motion.u, motion.v) + _LEVER_PX * abs(motion.turn_rad)
