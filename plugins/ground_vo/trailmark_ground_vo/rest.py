"""Whether a picture that stands still shows ground that stands still.

A lens that is covered, iced up or dirty all over shows the same in every picture, as ground does under a robot at rest.
Nothing in the pictures tells the two apart, unless what is seen has moved before: that it moves when the robot does,
and as other motions say, is what makes it ground.
"""

from __future__ import annotations

import math

from trailmark_ground_vo.motion import ImageMotion

__all__ = ["RestWatch"]

#: Shift from which on a content has moved, and up to which it stands still [px].
_MOVED_PX, _STILL_PX = 6.0, 1.0

#: Shift that others must expect for standing still to be a contradiction [px].
_EXPECTED_PX = 3.0

#: Share of the expected shift that is as good as none.
_STILL_SHARE = 0.2

#: Pictures in a row that move against what is expected before the mounting is doubted.
_MOST_AGAINST = 3


class RestWatch:
    """Watches whether what is remembered has been seen to move, and with others."""

    def __init__(self) -> None:
        self._has_moved = False
        self._was_moving = False
        self._n_against = 0
        self._u = self._v = self._turn_rad = 0.0

    def begin(self, last: ImageMotion | None) -> None:
        """Start anew with another content; `last` is the last motion before it was lost."""
        lost_moving = last is not None and math.hypot(last.u, last.v) > _EXPECTED_PX
        self._was_moving = lost_moving or (self._was_moving and not self._has_moved)
        self._has_moved, self._u, self._v, self._turn_rad = False, 0.0, 0.0, 0.0

    def add(self, motion: ImageMotion) -> None:
        """Take a motion that was believed."""
        self._u, self._v, self._turn_rad = self._u + motion.u, self._v + motion.v, self._turn_rad + motion.turn_rad
        if math.hypot(self._u, self._v) > _MOVED_PX or abs(self._turn_rad) > math.radians(3.0):
            self._has_moved = True

    @staticmethod
    def is_contradicted(found: ImageMotion, expected: ImageMotion | None) -> bool:
        """Return whether a content stands still while others move."""
        expected_px = 0.0 if expected is None else math.hypot(expected.u, expected.v)
        return expected_px > _EXPECTED_PX and math.hypot(found.u, found.v) <= max(_STILL_PX, _STILL_SHARE * expected_px)

    def reason_doubted(self, found: ImageMotion, expected: ImageMotion | None) -> str:
        """Return why a motion may not be that of the ground; empty when it may.

        Parameters
        ----------
        found : ImageMotion
            What the pictures say.
        expected : ImageMotion or None
            What others say, where they do.
        """
        shift_px = math.hypot(found.u, found.v)
        expected_px = 0.0 if expected is None else math.hypot(expected.u, expected.v)
        if expected is not None and expected_px > _EXPECTED_PX:
            against = found.u * expected.u + found.v * expected.v < -0.5 * expected_px**2
            self._n_against = self._n_against + 1 if against else 0
            if self._n_against >= _MOST_AGAINST:
                return (
                    "the ground moves against what other motions say: is the camera mounted the other way round"
                    " (mounting: yaw_deg)?"
                )
        if self._has_moved or shift_px > max(_STILL_PX, _STILL_SHARE * expected_px):
            return ""
        if expected_px > _EXPECTED_PX:
            return f"what is seen stands still, but others say {expected_px:.0f} px (lens covered, or dirty all over)"
        if self._was_moving and expected is None:
            return "what is seen stands still since the track was lost on the move (standing, or lens covered)"
        return ""
