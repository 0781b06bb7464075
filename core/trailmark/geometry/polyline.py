"""The nearest line of a polyline to a point."""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Floats

__all__ = ["Polyline"]

# Two points at one place: the line between them has no direction.
_NO_LENGTH_M2 = 1e-18
# More than sums of lengths of lines are off by rounding.
_ROUNDING_M = 1e-6


class Polyline:
    """Points joined by straight lines; line k goes from point k to point k + 1.

    Parameters
    ----------
    points : (N, 2) float64
        In order, at least two [m].
    """

    __slots__ = ("_lines", "_points", "_ways", "_xs", "_ys")

    def __init__(self, points: Floats) -> None:
        self._points = points
        with np.errstate(over="ignore"):  # a store may hold places beyond all distances
            self._lines = np.diff(points, axis=0).T
            ways = np.cumsum(np.hypot(*self._lines))
        # The same as plain floats: a few lines cost 1 us with them, and 15 us with arrays.
        self._xs: list[float] = points[:, 0].tolist()
        self._ys: list[float] = points[:, 1].tolist()
        self._ways: list[float] = [0.0, *ways.tolist()]

    def ends(self, index: int) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return where a line begins and where it ends."""
        return (self._xs[index], self._ys[index]), (self._xs[index + 1], self._ys[index + 1])

    def nearest(self, x: float, y: float) -> tuple[int, float]:
        """Return the line that is nearest to a point, the first of several, and where on it, 0 to 1."""
        line_x, line_y = self._lines
        from_x, from_y = x - self._points[:-1, 0], y - self._points[:-1, 1]
        squared = np.maximum(line_x * line_x + line_y * line_y, _NO_LENGTH_M2)
        fractions = np.minimum(np.maximum((from_x * line_x + from_y * line_y) / squared, 0.0), 1.0)
        miss_x, miss_y = from_x - fractions * line_x, from_y - fractions * line_y
        index = int((miss_x * miss_x + miss_y * miss_y).argmin())
        return index, float(fractions[index])

    def nearest_among(self, x: float, y: float, first: int, last: int, guess: int) -> tuple[int, float]:
        """Return the same of the lines from `first` up to `last`, faster the better the guess.

        A point of the polyline that is further away than the nearest line so far by some distance has no nearer line
        within that distance along the polyline, before it or after it. So most lines are passed over, in halves.
        """
        ways, xs, ys, best = self._ways, self._xs, self._ys, guess
        best_m2, fraction = self._miss_of(best, x, y)
        for beside in (guess - 1, guess + 1):  # without these two, a point on the polyline is clear of all others
            if first <= beside < last:
                miss_m2, along = self._miss_of(beside, x, y)
                if miss_m2 < best_m2 or (miss_m2 == best_m2 and beside < best):
                    best, best_m2, fraction = beside, miss_m2, along
        best_m = math.sqrt(best_m2) + _ROUNDING_M
        waiting = [(first, guess - 1), (guess + 2, last)]
        while waiting:
            low, high = waiting.pop()
            if low >= high:
                continue
            half = (low + high + 1) // 2
            clear_m = math.hypot(x - xs[half], y - ys[half]) - best_m
            if clear_m > ways[half] - ways[low] and clear_m > ways[high] - ways[half]:
                continue
            if high > low + 1:
                waiting += ((low, half), (half, high))
                continue
            miss_m2, along = self._miss_of(low, x, y)
            if miss_m2 < best_m2 or (miss_m2 == best_m2 and low < best):
                best, best_m2, fraction, best_m = low, miss_m2, along, math.sqrt(miss_m2) + _ROUNDING_M
        return best, fraction

    def miss(self, index: int, fraction: float, x: float, y: float) -> tuple[float, float, float]:
        """Return how far a point is from a place on a line, and where it is as seen from the line's beginning [m]."""
        xs, ys = self._xs, self._ys
        start_x, start_y = xs[index], ys[index]
        from_x, from_y = x - start_x, y - start_y
        miss_x, miss_y = from_x - fraction * (xs[index + 1] - start_x), from_y - fraction * (ys[index + 1] - start_y)
        return math.sqrt(miss_x * miss_x + miss_y * miss_y), from_x, from_y

    def _miss_of(self, index: int, x: float, y: float) -> tuple[float, float]:
        """Return the squared distance to a line, and where on it the nearest point is, 0 to 1."""
        xs, ys = self._xs, self._ys
        start_x, start_y = xs[index], ys[index]
        line_x, line_y, from_x, from_y = xs[index + 1] - start_x, ys[index + 1] - start_y, x - start_x, y - start_y
        squared = max(line_x * line_x + line_y * line_y, _NO_LENGTH_M2)
        fraction = min(max((from_x * line_x + from_y * line_y) / squared, 0.0), 1.0)
        miss_x, miss_y = from_x - fraction * line_x, from_y - fraction * line_y
        return miss_x * miss_x + miss_y * miss_y, fraction
