"""How crooked a map is, by how far scans end from its walls."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from trailmark.arrays import Floats

__all__ = ["MapError"]

#: What ends are off their walls on a map without error: the noise of a range [m].
_RANGE_SIGMA_M = 0.015
_FEWEST_ENDS = 10


class MapError:
    """What no fix is better than, because the map's walls are off.

    The walls that a scan sees are off together, so that matching more rays does not help: the excess of the ends'
    distances from their walls over noise and cells is the error of a place, over the rays' length that of a heading.
    It is the median of the last scans, so that people who walk by do not count, and a window that was worse than all
    before is kept for good: a map does not get better.

    Parameters
    ----------
    cell_m : float
        Side of a cell of the map [m].
    n_looks : int
        How many scans a window has.
    """

    def __init__(self, cell_m: float, n_looks: int = 40) -> None:
        self._expected = _RANGE_SIGMA_M**2 + cell_m**2 / 12.0
        self._squares: deque[float] = deque(maxlen=n_looks)
        self._lengths: deque[float] = deque(maxlen=n_looks)
        self._worst = 0.0

    def add(self, distances_m: Floats, rays: Floats) -> None:
        """Take a scan into account.

        Parameters
        ----------
        distances_m : (R,) float64
            Of the ends from their walls, NaN where there is none near [m].
        rays : (R, 2) float64
            The ends, in base axes [m].
        """
        is_near = np.isfinite(distances_m)
        if is_near.sum() < _FEWEST_ENDS:
            return
        self._squares.append(float(np.square(distances_m[is_near]).mean()))
        self._lengths.append(float(np.square(rays[is_near]).sum(axis=1).mean()))
        if len(self._squares) == self._squares.maxlen:
            self._worst = max(self._worst, float(np.median(self._squares)))

    def sigmas(self) -> tuple[float, float, float]:
        """Return the standard deviations of x, y [m] and of the heading [rad]; none while nothing was seen."""
        if not self._squares:
            return 0.0, 0.0, 0.0
        square = max(self._worst, float(np.median(self._squares)))
        excess_m = math.sqrt(max(0.0, square - self._expected))
        return excess_m, excess_m, excess_m / math.sqrt(float(np.median(self._lengths)))
