"""Resetting the origin at key landmarks (Sec. III): a distinct view says how far along the path the robot is."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from trailmark.estimates import Belief
from trailmark_divs.correspondence import Correspondence, Match
from trailmark_divs.eye import DifferenceWindow
from trailmark_divs.robust_shift import best_over_shifts, local_windows
from trailmark_divs.tracking import evidence_per_score
from trailmark_divs.windows import Windows

__all__ = ["AtLandmarks", "distinct_rows", "sameness"]


def sameness(
    windows: Windows, usable: npt.NDArray[np.bool_], correlation_window: int, apart: int, max_shift: int
) -> npt.NDArray[np.float64]:
    """Return how much each window resembles those `apart` rows before and after it, (M,); 1 near the ends.

    Parameters
    ----------
    windows : Windows
        Differences of the taught path, M of them.
    usable : (d,) bool
        Columns that may be compared.
    correlation_window : int
        Length of a local window [columns].
    apart : int
        Rows between the windows that are compared.
    max_shift : int
        Largest shift that is tried [columns].

    Returns
    -------
    (M,) float64
        Likeness, at most 1.
    """
    same = np.ones(len(windows))
    for row in range(apart, len(windows) - apart):
        seen = local_windows(windows.vectors[row], usable, correlation_window)
        others = windows.vectors[[row - apart, row + apart]]
        same[row] = best_over_shifts(others, usable, seen, max_shift).max()
    return same


def distinct_rows(same: npt.NDArray[np.float64], stations_m: npt.NDArray[np.float64], spacing_m: float) -> list[int]:
    """Return the most distinct windows, the best first, no two nearer than `spacing_m`."""
    chosen: list[int] = []
    for row in np.argsort(same, kind="stable").tolist():
        if same[row] < 1.0 and all(abs(stations_m[row] - stations_m[other]) >= spacing_m for other in chosen):
            chosen.append(row)
    return chosen


class AtLandmarks(Correspondence):
    """Another correspondence, corrected by appearance whenever it passes a landmark.

    Parameters
    ----------
    inner : Correspondence
        What says where the robot is between landmarks.
    windows : Windows
        The taught windows.
    landmarks : list of int
        Rows of the landmarks; see `distinct_rows`.
    usable : (d,) bool
        Columns that may be compared.
    window, correlation_window, max_shift : int
        As in the config. A landmark is looked for up to one window before and after its place.
    least_confidence : float
        A landmark that is found with less is passed by.
    """

    def __init__(
        self,
        inner: Correspondence,
        windows: Windows,
        landmarks: list[int],
        usable: npt.NDArray[np.bool_],
        window: int,
        correlation_window: int,
        max_shift: int,
        least_confidence: float,
    ) -> None:
        self._inner = inner
        self._windows = windows
        self._landmarks = np.array(sorted(landmarks), dtype=np.intp)
        self._usable = usable
        self._window = window
        self._correlation_window = correlation_window
        self._max_shift = max_shift
        self._least_confidence = least_confidence
        self._last_row: int | None = None

    def match(self, window: DifferenceWindow, belief: Belief) -> Match | None:
        """Return the match of the inner correspondence, or what was found at a landmark."""
        match = self._inner.match(window, belief)
        if match is None:
            return None
        last, self._last_row = self._last_row, match.row
        if last is None or not self._passes_landmark(last, match.row):
            return match
        found = self._search(window, match.row)
        if found.confidence < self._least_confidence:
            return match
        self._inner.reset(window, found.row)
        self._last_row = found.row
        return found

    def reset(self, window: DifferenceWindow, row: int) -> None:
        """Set the origin of the inner correspondence."""
        self._inner.reset(window, row)

    def _passes_landmark(self, last: int, row: int) -> bool:
        low, high = sorted((last, row))
        return bool(((self._landmarks > low) & (self._landmarks <= high)).any())

    def _search(self, window: DifferenceWindow, row: int) -> Match:
        first = max(0, row - self._window)
        stop = min(len(self._windows), row + self._window + 1)
        seen = local_windows(window.vector, self._usable, self._correlation_window)
        scores = best_over_shifts(self._windows.vectors[first:stop], self._usable, seen, self._max_shift)
        # One look has to decide: it counts for its whole window.
        mass = np.exp(evidence_per_score(1) * (scores - scores.max()))
        mass /= mass.sum()
        best = int(np.argmax(mass))
        reach = max(2, self._window // 4)
        confidence = float(mass[max(0, best - reach) : best + reach + 1].sum())
        if best in (0, len(mass) - 1):  # the best may lie outside of what was searched
            confidence = 0.0
        stations_m = self._windows.stations_m[first:stop]
        spread_m = math.sqrt(float((mass * (stations_m - stations_m[best]) ** 2).sum()))
        spacing_m = float(np.ptp(stations_m)) / max(1, len(stations_m) - 1)
        return Match(first + best, math.hypot(spread_m, spacing_m), confidence)
