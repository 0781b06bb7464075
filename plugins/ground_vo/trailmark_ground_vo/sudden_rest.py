"""Whether content that stands still may be held by marks, since it had moved and was doubted or lost.

Where marks are stronger than the ground, what says that the ground moves comes and goes, and in between the content
seems to stand still. A robot that stops so can wait to be believed.
"""

from __future__ import annotations

import math

from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.rivals import stands_still

__all__ = ["SuddenRest"]

#: Pictures in which the content has to stand still before that is believed.
_DISTRUST_FRAMES = 30

#: Content that moves by less than this share of what it did is held as well as one that stands.
_HELD_SHARE = 0.3


class SuddenRest:
    """Remembers how the content moved, and whether that was doubted since."""

    def __init__(self) -> None:
        self._pace_px = 0.0  # when it was last seen to move, as long as it is not known to stand
        self._n_left = 0

    def is_doubtful(self, motion: ImageMotion) -> bool:
        """Return whether a motion is that of content which marks may hold."""
        length_px = math.hypot(motion.u, motion.v)
        return self._n_left > 0 and (stands_still(motion) or length_px < _HELD_SHARE * self._pace_px)

    def believe(self, motion: ImageMotion) -> None:
        """Take a motion for that of the ground."""
        self._n_left, self._pace_px = 0, 0.0 if stands_still(motion) else math.hypot(motion.u, motion.v)

    def doubt(self, rival: ImageMotion | None, *, is_at_rest: bool) -> None:
        """Hear that a picture's motion was not believed.

        Parameters
        ----------
        rival : ImageMotion or None
            How most of the picture moved instead.
        is_at_rest : bool
            Noise explains a picture of content that stands still, and nothing speaks against it.
        """
        if rival is not None and not stands_still(rival):
            self._pace_px = math.hypot(rival.u, rival.v)
        if is_at_rest:
            self._n_left -= 1
        elif self._pace_px:
            self._n_left = _DISTRUST_FRAMES
