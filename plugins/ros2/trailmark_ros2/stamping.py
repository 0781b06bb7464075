"""Stamps of live messages, and how far the clock of their sender is from ours."""

from __future__ import annotations

import logging
from typing import Any, Literal

from trailmark.errors import SourceError
from trailmark.sources.clock_offset import ClockOffset

__all__ = ["Stamper"]

logger = logging.getLogger(__name__)

# Topics are live: what is so far ahead of its like has a wrong stamp. One of 3 s would end the run as a clock that went
# back, see `resets` [s].
_AHEAD_S = 2.0


class Stamper:
    """Stamps the messages of one topic, and measures stamp minus arrival.

    Parameters
    ----------
    topic : str
        For the log.
    stamps : {"header", "receive"}
        Which stamp counts.
    max_offset_s : float
        An offset beyond is warned of, once [s].
    """

    def __init__(self, topic: str, stamps: Literal["header", "receive"], max_offset_s: float) -> None:
        self._topic, self._stamps, self._max_offset_s = topic, stamps, max_offset_s
        self._clock = ClockOffset(_AHEAD_S)
        self._has_warned = False

    def stamp_s(self, message: Any, came_s: float) -> float | None:
        """Return the stamp of a message that came at a time; None: its sender left it empty [s].

        Raises
        ------
        SourceError
            If it is of the future, by the stamps before it: all after it would be of the past.
        """
        stamp = message.header.stamp
        header_s = float(stamp.sec) + float(stamp.nanosec) / 1e9
        if header_s == 0.0:
            return came_s if self._stamps == "receive" else None
        ahead_s = self._clock.note_message(header_s, came_s)
        self._warn_if_far(header_s - came_s)
        if self._stamps == "receive":
            return came_s
        if ahead_s:
            raise SourceError(f"its stamp is {ahead_s:.1f} s ahead of those before it")
        return header_s

    @property
    def offset_s(self) -> float:
        """Median of stamp minus arrival; not a number before the first message [s]."""
        return self._clock.median_s

    @property
    def begun_ahead_s(self) -> float:
        """How far the first stamp that counts was ahead of all after it; 0: it was not [s]."""
        return self._clock.begun_ahead_s if self._stamps == "header" else 0.0

    def _warn_if_far(self, offset_s: float) -> None:
        # A median is not too large before one of its offsets is; it is not asked for with every message.
        if self._has_warned or abs(offset_s) <= self._max_offset_s or not self._clock.is_known:
            return
        if abs(self.offset_s) <= self._max_offset_s:
            return
        self._has_warned = True
        remedy = "set stamps: receive, or synchronise the clocks" if self._stamps == "header" else "not used"
        logger.warning(
            "%s: header stamps are %.3f s %s of this machine's clock (%s)",
            self._topic,
            abs(self.offset_s),
            "ahead" if self.offset_s > 0 else "behind",
            remedy,
        )
