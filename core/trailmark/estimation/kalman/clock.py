"""Stamps that cannot be: a clock that was set, or stands still."""

from __future__ import annotations

import math
from typing import Literal

__all__ = ["ClockGuard", "gap_of_jump_s"]

# A clock that was set says nothing of how long it really took: the belief is as uncertain as after this gap.
_GAP_OF_A_SET_CLOCK_S = 10.0

# Stamps that go on by up to this may as well be those of a robot of which nothing was heard meanwhile.
_LONGEST_SILENCE_S = 3600.0


def gap_of_jump_s(later_s: float) -> float:
    """Return the gap after which a belief is as uncertain as after stamps have jumped.

    Parameters
    ----------
    later_s : float
        By how much the stamps have gone on; negative where they went back [s].
    """
    return max(later_s, _GAP_OF_A_SET_CLOCK_S) if later_s <= _LONGEST_SILENCE_S else _GAP_OF_A_SET_CLOCK_S


class ClockGuard:
    """Tells estimates that are merely late from those of another time.

    Parameters
    ----------
    jump_s : float
        A stamp further than this from the newest is of another time [s].
    n_to_reset : int or None
        How many in a row must agree on the other time before it is believed; None: it never is.
    """

    def __init__(self, jump_s: float, n_to_reset: int | None) -> None:
        self._jump_s = jump_s
        self._n_to_reset = n_to_reset
        self._jumped_s = -math.inf
        self._n = 0

    def is_near(self, stamp_s: float, newest_s: float) -> bool:
        """Return whether a stamp is of the time that the estimator lives in, and take no note of it."""
        return math.isfinite(stamp_s) and (abs(stamp_s - newest_s) <= self._jump_s or newest_s == -math.inf)

    def classify(self, stamp_s: float, newest_s: float) -> Literal["here", "elsewhere", "reset"]:
        """Return whether a stamp is of the time that the estimator lives in, given the newest that it has heard of."""
        if abs(stamp_s - newest_s) <= self._jump_s or newest_s == -math.inf:
            self._n = 0
            return "here"
        agrees = abs(stamp_s - self._jumped_s) <= self._jump_s
        self._n = self._n + 1 if agrees else 1
        self._jumped_s = stamp_s
        if self._n_to_reset is None or self._n < self._n_to_reset:
            return "elsewhere"
        self._n = 0
        return "reset"
