"""Whether a picture that stands still shows ground that stands still.

A lens that is covered, iced up or dirty all over shows the same in every picture, as ground does under a robot at rest.
Little in the pictures tells the two apart, unless what is seen has moved before: that it moves when the robot does, and
as other motions say, is what makes it ground. Before, and where nobody else tells, the first thing that is seen is
ground if it has texture in focus; after a loss it is if it is the ground that was seen before.
"""

from __future__ import annotations

import math

from trailmark_ground_vo.motion import ImageMotion

__all__ = ["RestWatch"]

#: Shift and turn from which on a content in focus has moved [px], [rad]; of one out of focus, so many times as much.
_MOVED_PX, _MOVED_RAD, _OUT_OF_FOCUS = 6.0, math.radians(3.0), 4.0

#: Shift up to which a content stands still [px].
_STILL_PX = 1.0

#: Shift that others must expect for standing still to be a contradiction [px].
_EXPECTED_PX = 3.0

#: Share of the expected shift that is as good as none.
_STILL_SHARE = 0.2

#: Pictures in a row that move against what is expected before the mounting is doubted.
_MOST_AGAINST = 3


class RestWatch:
    """Watches whether what is remembered has been seen to move, and with others."""

    def __init__(self) -> None:
        self._has_moved = self._is_ground = False
        self._was_told = False
        self._n_against = 0
        self._u = self._v = self._turn_rad = 0.0

    @property
    def has_moved(self) -> bool:
        """Whether what is seen now has been seen to move."""
        return self._has_moved

    @property
    def lacks_evidence(self) -> bool:
        """Whether neither a motion nor its look has told that what is seen now is ground."""
        return not (self._has_moved or self._is_ground)

    def begin(self, *, was_told: bool) -> None:
        """Start anew with another content; whether motions were told before."""
        self._was_told = was_told
        self._has_moved, self._is_ground, self._u, self._v, self._turn_rad = False, False, 0.0, 0.0, 0.0

    def recognise(self) -> None:
        """Take what is seen now for ground by its look."""
        self._is_ground = True

    def add(self, motion: ImageMotion, *, is_in_focus: bool = True) -> None:
        """Take a motion that was found."""
        self._u, self._v, self._turn_rad = self._u + motion.u, self._v + motion.v, self._turn_rad + motion.turn_rad
        far = max(math.hypot(self._u, self._v) / _MOVED_PX, abs(self._turn_rad) / _MOVED_RAD)
        if far > (1.0 if is_in_focus else _OUT_OF_FOCUS):
            self._has_moved = True

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
        if self._has_moved:
            return ""
        if expected is None:
            return "" if self._is_ground else self._reason_unknown()
        if expected_px > _EXPECTED_PX and shift_px <= max(_STILL_PX, _STILL_SHARE * expected_px):
            return f"what is seen stands still, but others say {expected_px:.0f} px (lens covered, or dirty all over)"
        return ""

    def _reason_unknown(self) -> str:
        if self._was_told:
            return "what is seen has not moved since the track was lost (standing, or lens covered)"
        return "what is seen has not moved and has no texture in focus (plain ground, or lens covered)"
