"""Tracking a shift: a probability over all shifts, carried from picture to picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark.kernels import kernel
from trailmark_divs.robust_shift import summit

__all__ = ["REACH", "ShiftTracker", "TrackedShift", "evidence_per_score", "updated_probability"]

#: Columns on each side of the peak that count as the same answer.
REACH = 2

# A peak that stands out by this much for a whole window of differences is worth odds of 100 to 1.
_MARGIN = 0.17
_ODDS = 100.0
# How far the shift wanders while a window passes by (one sigma) [columns], and how often it jumps anywhere: where
# nothing measures turns, and where they are measured and the tracker moves with them, so that only sideways drift and
# things of other depths remain. Then a far jump takes the evidence of several windows.
_WANDER_COLUMNS, _JUMPS_PER_WINDOW = 2.2, 0.025
_WANDER_WITH_TURNS_COLUMNS, _JUMPS_WITH_TURNS_PER_WINDOW = 1.5, 1e-6


def evidence_per_score(window: int) -> float:
    """Return the log-odds of a difference of 1 in one picture's score.

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


@dataclass(frozen=True, slots=True, eq=False)
class _Wandering:
    """What may happen to the shift from picture to picture: how it spreads, and how often it jumps."""

    kernel: npt.NDArray[np.float64]
    leak: float

    @classmethod
    def of(cls, wander_columns: float, jumps_per_window: float, window: int) -> _Wandering:
        return cls(_gaussian(wander_columns / math.sqrt(window)), min(0.5, jumps_per_window / window))


class ShiftTracker:
    """A histogram filter over the shift.

    A bounded search around a filtered shift, with global re-initialisation, in one rule: the probability spreads
    a little between pictures, leaks a little to all shifts, and is multiplied by what the scores say.

    Attributes
    ----------
    are_turns_measured : bool
        Something measures turns, and `move` is told of them: the shift then wanders less and jumps hardly ever.
    """

    def __init__(self, max_shift: int, window: int) -> None:
        self._max_shift = max_shift
        self._evidence = evidence_per_score(window)
        self._wandering = _Wandering.of(_WANDER_COLUMNS, _JUMPS_PER_WINDOW, window)
        self._with_turns = _Wandering.of(_WANDER_WITH_TURNS_COLUMNS, _JUMPS_WITH_TURNS_PER_WINDOW, window)
        self.are_turns_measured = False
        self.restart()

    def restart(self) -> None:
        """Forget: every shift is as likely as any other."""
        n_shifts = 2 * self._max_shift + 1
        self._probability = np.full(n_shifts, 1.0 / n_shifts)
        self._rest = 0.0

    def move(self, columns: float) -> None:
        """Shift the probability by what a known turn of the robot does to the picture [columns]."""
        self._rest += columns
        whole = round(self._rest)
        self._rest -= whole  # kept for later: interpolating a little every time would wash the probability out
        if whole == 0:
            return
        n_shifts = len(self._probability)
        places = np.arange(n_shifts) - whole
        inside = (places >= 0) & (places < n_shifts)
        moved = np.where(inside, self._probability[np.clip(places, 0, n_shifts - 1)], 0.0)
        if moved.any():
            self._probability = moved / moved.sum()
        else:
            self.restart()

    def update(self, scores: npt.NDArray[np.float64]) -> TrackedShift:
        """Take the scores of a picture, (2 max_shift + 1,), and return the tracked shift."""
        how = self._with_turns if self.are_turns_measured else self._wandering
        self._probability = updated_probability(self._probability, how.kernel, how.leak, self._evidence, scores)
        place, confidence, margin, score = _read(self._probability, scores)
        return TrackedShift(place - self._max_shift, confidence, margin, score)


@kernel
def updated_probability(
    probability: npt.NDArray[np.float64],
    kernel: npt.NDArray[np.float64],
    leak: float,
    evidence: float,
    scores: npt.NDArray[np.float64],
) -> npt.NDArray[np.float64]:
    """Spread a probability with a kernel, leak it to all places, and weigh it by scores; all (n,), kernel odd.

    What would spread over an end stays there.

    Parameters
    ----------
    probability : (n,) float64
        Over n shifts or places.
    kernel : (k,) float64
        What the probability is convolved with; k is odd.
    leak : float
        Share that goes to all places alike.
    evidence : float
        Log-odds of a difference of 1 in the scores.
    scores : (n,) float64
        Likeness at each place.

    Returns
    -------
    (n,) float64
        The new probability; its sum is 1.
    """
    n_places, reach = len(probability), len(kernel) // 2
    spread = np.zeros(n_places, dtype=np.float64)
    for place in range(n_places):
        for offset in range(-reach, reach + 1):
            target = min(max(place + offset, 0), n_places - 1)
            spread[target] += probability[place] * kernel[offset + reach]
    best = scores.max()
    total = 0.0
    for place in range(n_places):
        prior = (1.0 - leak) * spread[place] + leak / n_places
        spread[place] = prior * np.exp(evidence * (scores[place] - best))
        total += spread[place]
    return spread / total


@kernel
def _read(probability: npt.NDArray[np.float64], scores: npt.NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Return place, confidence, margin and score of the likeliest shift; see `TrackedShift`."""
    n_places = len(probability)
    likeliest = int(np.argmax(probability))
    place = summit(scores, likeliest, REACH)
    top = round(place)
    confidence, elsewhere = 0.0, -np.inf
    for other in range(n_places):
        if abs(other - likeliest) <= REACH:
            confidence += probability[other]
        if abs(other - top) > REACH:
            elsewhere = max(elsewhere, scores[other])
    margin = scores[top] - elsewhere if elsewhere > -np.inf else 0.0
    return place, confidence, margin, scores[top]


def _gaussian(sigma: float) -> npt.NDArray[np.float64]:
    reach = max(1, math.ceil(3.0 * sigma))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return np.asarray(kernel / kernel.sum())
