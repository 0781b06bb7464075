"""What the areas of a taught picture are worth to tell its place, from the pictures that were taught around it.

An area that hardly changes from one picture to the next, and looks otherwise half a metre on, tells the place: a
poster, a door, what stands near by. The lamps and the far end of a corridor look the same half a metre on, and in the
next corridor. Of an area that changes from picture to picture, as walls do that are very near, less can be asked.
"""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Bools, Float32s, Floats
from trailmark.patches import patch_scores
from trailmark_divs.area_fits import AREA_STEP_PX, area_grid

__all__ = ["AreaWorth"]

_ELSEWHERE_M = 0.4
_LEAST_WORTH = 0.05  # a picture whose areas all look the same there still tells something
#: What is asked of an area at the most, and at the least: a camera of much noise must not fit to anything.
_MOST_ASKED, _LEAST_ASKED = 0.85, 0.5


class AreaWorth:
    """Weights of the areas of taught pictures, and what is to be asked of each.

    Parameters
    ----------
    pictures : (K, h, w) float32
        Small taught pictures.
    clear : (K, h, w) bool
        Which of their pixels count.
    stations_m : (K,) float64
        Where they were taught [m].
    """

    def __init__(self, pictures: Float32s, clear: Bools, stations_m: Floats) -> None:
        self._pictures, self._clear, self._stations_m = pictures, clear, stations_m
        self._known: dict[int, tuple[Floats, Floats]] = {}

    def __len__(self) -> int:
        """Return of how many taught pictures the worth of the areas has been found; it is found when asked for."""
        return len(self._known)

    def weighed(self, row: int, grid: Floats, shift_px: int) -> tuple[Floats, Floats]:
        """Return the fits of the areas that count, by what is to be asked of each, and their weights, each (N,).

        Parameters
        ----------
        row : int
            The taught picture that they were compared with.
        grid : (V, U) float64
            Fits of the areas of the seen picture, as `area_grid` returns them.
        shift_px : int
            By which the seen picture was shifted [px].
        """
        asked, weights = self._of(row)
        columns = np.round((np.arange(grid.shape[1]) * AREA_STEP_PX - shift_px) / AREA_STEP_PX).astype(np.intp)
        inside = (columns >= 0) & (columns < grid.shape[1])
        fits, columns = grid[:, inside], columns[inside]
        asked, weights = asked[:, columns], weights[:, columns]
        counts = np.isfinite(fits) & np.isfinite(weights)
        return _MOST_ASKED * fits[counts] / asked[counts], weights[counts]

    def _of(self, row: int) -> tuple[Floats, Floats]:
        """Return what is asked of the areas of a taught picture, and their weights; NaN where nobody knows."""
        if row not in self._known:
            beside = self._fits_with(row, self._beside(row))
            elsewhere = self._fits_with(row, self._elsewhere(row))
            self._known[row] = (
                np.clip(beside, _LEAST_ASKED, _MOST_ASKED),
                _LEAST_WORTH + np.maximum(beside - elsewhere, 0.0),
            )
        return self._known[row]

    def _beside(self, row: int) -> list[int]:
        return [other for other in (row - 1, row + 1) if 0 <= other < len(self._pictures)]

    def _elsewhere(self, row: int) -> list[int]:
        before, after = np.searchsorted(self._stations_m, self._stations_m[row] + np.array([-1, 1]) * _ELSEWHERE_M)
        rows = [min(int(before), row - 2), max(int(after), row + 2)]
        return [other for other in rows if 0 <= other < len(self._pictures)]

    def _fits_with(self, row: int, others: list[int]) -> Floats:
        """Return how well the areas of a taught picture fit in others, where each has a say, in the mean."""
        grids = np.array([self._grid(row, other) for other in others])
        if not len(grids):
            return np.full_like(self._grid(row, row), np.nan)
        n = np.isfinite(grids).sum(axis=0)
        return np.asarray(np.where(n > 0, np.nansum(grids, axis=0) / np.maximum(n, 1), np.nan))

    def _grid(self, row: int, other: int) -> Floats:
        scores = patch_scores(self._pictures[other], self._pictures[row])
        shift_px = int(np.argmax(scores)) - len(scores) // 2
        return area_grid([self._pictures[other]], self._clear[other], self._pictures[row], self._clear[row], shift_px)
