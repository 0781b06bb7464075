"""Correspondence by appearance: the change vectors themselves say where on the path they were taught.

A histogram filter over the taught windows. It needs no odometry (one picture further per picture is then the
expectation), starts anywhere, and notices when the robot has been carried elsewhere.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from trailmark.estimates import Belief
from trailmark_divs.correspondence import Correspondence, Match, direction
from trailmark_divs.eye import DifferenceWindow
from trailmark_divs.robust_shift import best_over_shifts, local_windows
from trailmark_divs.tracking import evidence_per_score
from trailmark_divs.windows import Windows

__all__ = ["AppearanceFilter", "ByAppearance", "unrelated_score"]

_JUMPS_PER_WINDOW = 0.025  # how often the robot is found where it was not expected
_SPREAD_ROWS = 1.0  # how much the advance from picture to picture varies (one sigma)
_UNLIKELY = 1e-4  # of the likeliest: not looked at
_MOST_ROWS = 400  # looked at per picture; while the place is unknown, a longer path is looked at in steps
_UNRELATED_PAIRS = 200
_UNRELATED_PERCENTILE = 95.0


def unrelated_score(
    windows: Windows, usable: npt.NDArray[np.bool_], correlation_window: int, max_shift: int, apart: int
) -> float:
    """Return what a window scores, at its best shift, with windows of other places of this very path.

    Parameters
    ----------
    windows : Windows
        The taught windows.
    apart : int
        Windows at least this many rows apart show different places.

    Returns
    -------
    float
        95th percentile over pairs spread evenly over the path; -1 where the path is too short to tell.
    """
    n_others = len(windows) - apart
    if n_others < 1:
        return -1.0
    rows = np.linspace(0, n_others - 1, min(n_others, _UNRELATED_PAIRS)).astype(np.intp)
    scores = [
        best_over_shifts(
            windows.vectors[row + apart : row + apart + 1],
            usable,
            local_windows(windows.vectors[row], usable, correlation_window),
            max_shift,
        )[0]
        for row in rows
    ]
    return float(np.percentile(scores, _UNRELATED_PERCENTILE))


class AppearanceFilter:
    """A probability over the taught windows.

    Parameters
    ----------
    windows : Windows
        The taught windows.
    usable : (d,) bool
        Columns that may be compared.
    window, correlation_window, max_shift : int
        As in the config.
    look_back, look_ahead : int
        How far from the expected advance the next window may lie [rows].
    """

    def __init__(
        self,
        windows: Windows,
        usable: npt.NDArray[np.bool_],
        window: int,
        correlation_window: int,
        max_shift: int,
        look_back: int,
        look_ahead: int,
    ) -> None:
        self._windows = windows
        self._usable = usable
        self._correlation_window = correlation_window
        self._max_shift = max_shift
        self._reach = max(2, window // 2)
        self._evidence = evidence_per_score(window)
        self._leak = min(0.5, _JUMPS_PER_WINDOW / window)
        advances = np.arange(-look_back, look_ahead + 1)
        kernel = np.exp(-0.5 * (advances / _SPREAD_ROWS) ** 2)
        self._kernel = kernel / kernel.sum()
        self._look_back = look_back
        self._unrelated = unrelated_score(windows, usable, correlation_window, max_shift, 3 * window)
        self._smoothing = 1.0 / window
        self.restart()

    def __len__(self) -> int:
        return len(self._windows)

    @property
    def is_searching(self) -> bool:
        """True while the place is not known: from the start, and after it was lost."""
        return self._is_searching

    def restart(self) -> None:
        """Forget: the robot may be anywhere on the path."""
        self._probability = np.full(len(self._windows), 1.0 / max(1, len(self._windows)))
        self._is_searching = True
        self._level: float | None = None

    def update(self, vector: npt.NDArray[np.float64], advance_m: float | None) -> Match:
        """Take a replayed change vector and return the likeliest window.

        Parameters
        ----------
        vector : (d,) float64
            Change vector.
        advance_m : float or None
            Way along the path since the last one, negative backwards; None where nothing measures it [m].
        """
        self._predict(advance_m)
        rows = self._rows_to_look_at()
        seen = local_windows(vector, self._usable, self._correlation_window)
        scores = best_over_shifts(self._windows.vectors[rows], self._usable, seen, self._max_shift)
        weights = np.zeros(len(self._windows))
        weights[rows] = np.exp(self._evidence * (scores - scores.max()))
        posterior = self._probability * weights
        self._probability = posterior / posterior.sum()
        self._watch(float(scores.max()))
        return self._read()

    def _predict(self, advance_m: float | None) -> None:
        moved = self._advance_probability(advance_m)
        wide = np.convolve(moved, self._kernel)
        spread = wide[self._look_back : self._look_back + len(moved)]
        self._probability = (1.0 - self._leak) * spread / max(spread.sum(), 1e-300) + self._leak / len(spread)

    def _advance_probability(self, advance_m: float | None) -> npt.NDArray[np.float64]:
        """Move the probability along the path: by stations, so that it comes out behind a gap."""
        rows = np.arange(len(self._probability))
        if advance_m is None:
            targets = rows + 1
        else:
            stations_m = self._windows.stations_m
            middles_m = (stations_m[1:] + stations_m[:-1]) / 2.0
            targets = np.searchsorted(middles_m, stations_m + advance_m)
        moved = np.zeros_like(self._probability)
        np.add.at(moved, np.clip(targets, 0, len(rows) - 1), self._probability)
        return moved

    def _rows_to_look_at(self) -> npt.NDArray[np.intp]:
        likely = np.flatnonzero(self._probability > _UNLIKELY * self._probability.max())
        if self._is_searching or len(likely) > _MOST_ROWS:
            step = max(1, math.ceil(len(self._probability) / _MOST_ROWS))
            return np.arange(0, len(self._probability), step)
        return likely

    def _watch(self, best: float) -> None:
        """Search everywhere again when the best score has, for a window, been that of unrelated places."""
        self._level = best if self._level is None else self._level + self._smoothing * (best - self._level)
        if not self._is_searching and self._level < self._unrelated:
            self.restart()

    def _read(self) -> Match:
        row = int(np.argmax(self._probability))
        near = slice(max(0, row - self._reach), row + self._reach + 1)
        mass = self._probability[near]
        confidence = float(mass.sum())
        stations_m = self._windows.stations_m[near]
        mean_m = float((mass * stations_m).sum() / confidence)
        variance = float((mass * (stations_m - mean_m) ** 2).sum() / confidence)
        spacing_m = float(np.ptp(stations_m)) / max(1, len(stations_m) - 1)
        if confidence > 0.5:
            self._is_searching = False
        return Match(row, math.sqrt(variance + spacing_m**2), confidence)


class ByAppearance(Correspondence):
    """Correspondence by an `AppearanceFilter`.

    Parameters
    ----------
    places : AppearanceFilter
        Gives the probability of every place of the path.
    least_confidence : float
        Below this probability there is no correspondence.
    """

    def __init__(self, places: AppearanceFilter, least_confidence: float) -> None:
        self._places = places
        self._least_confidence = least_confidence
        self._travelled_m: float | None = None

    def match(self, window: DifferenceWindow, belief: Belief) -> Match | None:
        """Return the match; None while the place is not clear."""
        if not len(self._places):
            return None
        advance_m = None
        if self._travelled_m is not None and math.isfinite(belief.motion_age_s):
            advance_m = direction(belief) * (window.travelled_m - self._travelled_m)
        self._travelled_m = window.travelled_m
        match = self._places.update(window.vector, advance_m)
        return match if match.confidence >= self._least_confidence else None
