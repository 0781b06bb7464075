"""Stamps of live messages, and how far the clock of their sender is from ours."""

from __future__ import annotations

import logging
import math
from collections import deque
from statistics import median
from typing import Any, Literal

__all__ = ["Stamper"]

logger = logging.getLogger(__name__)

_N_OFFSETS = 101


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
        self._offsets_s: deque[float] = deque(maxlen=_N_OFFSETS)
        self._has_warned = False

    def stamp_s(self, message: Any, came_s: float) -> float | None:
        """Return the stamp of a message that came at a time; None: its sender left it empty [s]."""
        stamp = message.header.stamp
        header_s = float(stamp.sec) + float(stamp.nanosec) / 1e9
        if header_s == 0.0:
            return came_s if self._stamps == "receive" else None
        self._offsets_s.append(header_s - came_s)
        self._warn_if_far()
        return came_s if self._stamps == "receive" else header_s

    @property
    def offset_s(self) -> float:
        """Median of stamp minus arrival; not a number before the first message [s]."""
        return median(self._offsets_s) if self._offsets_s else math.nan

    def _warn_if_far(self) -> None:
        if self._has_warned or len(self._offsets_s) < 5 or abs(self.offset_s) <= self._max_offset_s:
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
