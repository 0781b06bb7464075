"""How far the clock of a robot is from ours, and which of its stamps cannot be."""

from __future__ import annotations

import math
from collections import deque
from statistics import median

__all__ = ["ClockOffset"]

_N_KEPT = 101
_N_NEEDED = 5
# Messages that wait somewhere come late, and never early: what is so far ahead of its like is a wrong stamp [s] ...
_AHEAD_S = 10.0
# ... unless so many after one another are, each later than the one before: then time has passed, the clock was set
# anew, or it runs faster than ours, as that of a replay does.
_N_BELIEVED = 3
# Of a clock that runs faster, one message may be missing.
_N_GAINS = 2


class ClockOffset:
    """Stamp minus arrival of the messages of one sensor.

    A single stamp of the future would otherwise make every stamp after it one of the past.

    Parameters
    ----------
    ahead_s : float
        A stamp that is so far ahead of all before it is not believed at once [s].
    """

    def __init__(self, ahead_s: float = _AHEAD_S) -> None:
        self._most_ahead_s = ahead_s
        self._offsets_s: deque[float] = deque(maxlen=_N_KEPT)
        self._ahead: list[tuple[float, float]] = []  # stamp and offset of the last messages, if they are suspicious
        self._gain_s = 0.0  # by how much the offset grows from message to message, where that is no jitter
        self._first: tuple[float, float] | None = None  # stamp and offset of the first message, until another agrees
        self._behind_s: list[float] = []  # offsets of those that are far behind it

    @property
    def is_known(self) -> bool:
        """Whether enough messages have come to estimate the offset."""
        return len(self._offsets_s) >= _N_NEEDED

    @property
    def median_s(self) -> float:
        """Median of stamp minus arrival; not a number before the first message [s]."""
        return median(self._offsets_s) if self._offsets_s else math.nan

    @property
    def begun_ahead_s(self) -> float:
        """How far the first message was ahead of all after it, once that is certain; 0: it was not [s].

        Nothing can be done about it: whoever believed the first stamp is in the future.
        """
        if self._first is None or len(self._behind_s) < _N_BELIEVED:
            return 0.0
        return self._first[1] - median(self._behind_s)

    def note_message(self, stamp_s: float, came_s: float) -> float:
        """Take note of a message; return how far its stamp is ahead of all before it if it is not to be believed.

        Parameters
        ----------
        stamp_s, came_s : float
            Its stamp, by the robot's clock, and its arrival, by ours [s].

        Returns
        -------
        float
            0 where it is believed [s].
        """
        offset_s = stamp_s - came_s
        self._compare_with_first(stamp_s, offset_s)
        last_s = self._offsets_s[-1] if self._offsets_s else offset_s
        # Not far ahead of the last is not far ahead of all: mostly they need not be gone through.
        ahead_s = offset_s - last_s
        if ahead_s > self._most_ahead_s:
            ahead_s = offset_s - max(self._offsets_s)
        if ahead_s <= self._most_ahead_s:
            self._gain_s = 0.0
        elif ahead_s > self._most_ahead_s + _N_GAINS * self._gain_s:
            self._note_ahead(stamp_s, offset_s)
            if len(self._ahead) < _N_BELIEVED:
                return ahead_s
            self._gain_s = max(0.0, offset_s - self._ahead[-2][1])
        self._ahead.clear()
        self._offsets_s.append(offset_s)
        return 0.0

    def _note_ahead(self, stamp_s: float, offset_s: float) -> None:
        """Take note of a suspicious message; one that is older than the one before it says that either is wrong."""
        if self._ahead and stamp_s < self._ahead[-1][0]:
            self._ahead.clear()
        if not self._ahead or stamp_s > self._ahead[-1][0]:
            self._ahead.append((stamp_s, offset_s))

    def _compare_with_first(self, stamp_s: float, offset_s: float) -> None:
        """Count the messages at the beginning that went back; one that waited has a later stamp than the first."""
        if not self._offsets_s:
            self._first = stamp_s, offset_s
        elif self._first is not None and stamp_s < self._first[0] and offset_s < self._first[1] - self._most_ahead_s:
            self._behind_s.append(offset_s)
        elif len(self._behind_s) < _N_BELIEVED:
            self._first = None
