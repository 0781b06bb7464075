"""Turns clutter the stream (Fig. 2): when one begins and ends, and how far a picture has turned."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from trailmark_divs.robust_shift import local_windows, shift_scores, summit

__all__ = ["TurnGate", "turned_columns"]

_SHARE_OF_WINDOW = 5  # the rate of turn is averaged over a fifth of a window
_LEAST_STEPS = 3


class TurnGate:
    """Says whether the robot is turning too fast for the stream.

    It is, from when the rate of turn, kept up for a whole window, would exceed the limit, until it has fallen
    below half of that.

    Parameters
    ----------
    limit_rad : float
        Turn within a window [rad].
    window : int
        Pictures in a window.
    """

    def __init__(self, limit_rad: float, window: int) -> None:
        self._limit_rad = limit_rad
        self._window = window
        self._steps_rad: deque[float] = deque(maxlen=max(_LEAST_STEPS, window // _SHARE_OF_WINDOW))
        self._is_turning = False

    def push(self, step_rad: float) -> bool:
        """Take the turn since the last picture [rad]; return whether the robot is turning."""
        self._steps_rad.append(step_rad)
        turn_rad = abs(sum(self._steps_rad)) / self._steps_rad.maxlen * self._window  # type: ignore[operator]
        self._is_turning = turn_rad > (self._limit_rad / 2.0 if self._is_turning else self._limit_rad)
        return self._is_turning


def turned_columns(
    before: npt.NDArray[np.float64],
    now: npt.NDArray[np.float64],
    usable: npt.NDArray[np.bool_],
    window: int,
    max_shift: int,
) -> float:
    """Return how far the picture moved to the right between two brightness profiles, which is a turn to the left.

    Parameters
    ----------
    before, now : (d,) float64
        Mean brightness of each column.
    usable : (d,) bool
        Columns that may be compared.
    window : int
        Length of a correlation window [columns].
    max_shift : int
        Largest movement [columns].

    Returns
    -------
    float
        Movement [columns].
    """
    scores = shift_scores(local_windows(before, usable, window), local_windows(now, usable, window), max_shift)
    if scores.max() <= 0.0:  # nothing to see: no reason to think of a turn
        return 0.0
    return summit(scores, int(np.argmax(scores))) - max_shift
