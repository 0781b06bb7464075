"""Tracking a shift: a probability over all shifts, carried from picture to picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark_divs.robust_shift import summit

__all__ = ["ShiftTracker", "TrackedShift", "evidence_per_score"]

#: Columns on each side of the peak that count as the same answer.
REACH = 2

# A peak that stands out by this much for a whole window of differences is worth odds of 100 to 1.
_MARGIN = 0.17
_ODDS = 100.0
# How far the shift wanders while a window passes by (one sigma) [columns], and how often it jumps anywhere.
_WANDER_COLUMNS = 2.2
_JUMPS_PER_WINDOW = 0.025


def evidence_per_score(window: int) -> float:
    """Return the log-odds that one picture's score difference of 1 is worth.

    Pictures whose windows overlap tell nearly the same, so a window's worth is shared out among its w pictures.
    """
    return math.log(_ODDS) / _MARGIN / window


@dataclass(frozen=True, slots=True)
class TrackedShift:
    """What the tracker makes of the scores.

    Attributes
    ----------
    columns : float
        The shift [columns].
    confidence : float
        Probability of a shift within `REACH` columns of it.
    margin : float
        Its score less the best score farther than `REACH` columns away, of this picture alone; negative when
        the tracker holds on to a shift against a higher peak elsewhere.
    score : float
        Its score, a mean correlation.
    """

    columns: float
    confidence: float
    margin: float
    score: float


class ShiftTracker:
    """A histogram filter over the shift.

    A bounded search around a filtered shift, with global re-initialisation, in one rule: the probability spreads
    a little between pictures, leaks a little to all shifts, and is multiplied by what the scores say.
    """

    def __init__(self, max_shift: int, window: int) -> None:
        self._max_shift = max_shift
        self._evidence = evidence_per_score(window)
        self._leak = min(0.5, _JUMPS_PER_WINDOW / window)
        self._kernel = _gaussian(_WANDER_COLUMNS / math.sqrt(window))
        self.restart()

    def restart(self) -> None:
        """Forget: every shift is as likely as any other."""
        n_shifts = 2 * self._max_shift + 1
        self._probability = np.full(n_shifts, 1.0 / n_shifts)

    def move(self, columns: float) -> None:
        """Shift the probability by what a known turn of the robot does to the picture [columns]."""
        places = np.arange(len(self._probability), dtype=np.float64)
        moved = np.interp(places - columns, places, self._probability, left=0.0, right=0.0)
        total = float(moved.sum())
        if total > 0.0:
            self._probability = moved / total
        else:
            self.restart()

    def update(self, scores: npt.NDArray[np.float64]) -> TrackedShift:
        """Take the scores of a picture, (2 max_shift + 1,), and return the tracked shift."""
        spread = _convolved(self._probability, self._kernel)
        prior = (1.0 - self._leak) * spread + self._leak / len(spread)
        weighted = prior * np.exp(self._evidence * (scores - scores.max()))
        self._probability = weighted / weighted.sum()
        return self._read(scores)

    def _read(self, scores: npt.NDArray[np.float64]) -> TrackedShift:
        likeliest = int(np.argmax(self._probability))
        place = summit(scores, likeliest, REACH)
        near = slice(max(0, likeliest - REACH), likeliest + REACH + 1)
        top = round(place)
        elsewhere = np.concatenate([scores[: max(0, top - REACH)], scores[top + REACH + 1 :]])
        return TrackedShift(
            columns=place - self._max_shift,
            confidence=float(self._probability[near].sum()),
            margin=float(scores[top] - elsewhere.max()) if len(elsewhere) else 0.0,
            score=float(scores[top]),
        )


def _gaussian(sigma: float) -> npt.NDArray[np.float64]:
    reach = max(1, math.ceil(3.0 * sigma))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return np.asarray(kernel / kernel.sum())


def _convolved(probability: npt.NDArray[np.float64], kernel: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Convolve; what would run over an end stays there."""
    reach = len(kernel) // 2
    wide = np.convolve(probability, kernel)
    inside = wide[reach:-reach].copy()
    inside[0] += wide[:reach].sum()
    inside[-1] += wide[-reach:].sum()
    return np.asarray(inside)
