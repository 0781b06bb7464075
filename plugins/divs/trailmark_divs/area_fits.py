"""Kernel: how well the areas of one small picture are found in others."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import AnyArray, Bools, Float32s, Floats, Int64s

__all__ = ["AREA_STEP_PX", "area_fits", "area_grid"]

_AREA_PX, AREA_STEP_PX = 12, 6
_MOVED_PX = (4, 2)  # an area may lie so far aside, and up or down, of where the whole picture has it
_LEAST_DEVIATION = 0.3  # of an area that shows something, in units of its patches
_MOST_HIDDEN = 0.05  # share of an area that may be over-exposed


def area_fits(taught: list[Float32s], taught_clear: Bools, seen: Float32s, seen_clear: Bools, shift_px: int) -> Floats:
    """Return how well each area of a seen picture is found in one of some taught ones, (K,) in [-1, 1].

    Parameters
    ----------
    taught : list of (h, w) float32
        Small taught pictures of one place; the middle one says what an area showed.
    taught_clear, seen_clear : (h, w) bool
        Which pixels count.
    seen : (h, w) float32
        Small seen picture.
    shift_px : int
        What is seen lies so much further right than in the taught pictures [px].
    """
    grid = area_grid(taught, taught_clear, seen, seen_clear, shift_px)
    return grid[np.isfinite(grid)]


def area_grid(taught: list[Float32s], taught_clear: Bools, seen: Float32s, seen_clear: Bools, shift_px: int) -> Floats:
    """Return how well each area of a seen picture is found in one of some taught ones, by row and column of areas.

    Parameters are those of `area_fits`.

    Returns
    -------
    (V, U) float64
        In [-1, 1]; NaN for areas that have no say: they lie outside, show nothing, or are over-exposed.
    """
    height, width = seen.shape
    tops, lefts = (np.arange(0, side - _AREA_PX + 1, AREA_STEP_PX) for side in (height, width))
    grid = np.full((len(tops), len(lefts)), np.nan)
    firsts = lefts - shift_px
    columns = np.flatnonzero((firsts >= _MOVED_PX[0]) & (firsts + _AREA_PX + _MOVED_PX[0] <= width))
    if not len(columns):
        return grid
    here, there = (tops, lefts[columns]), (tops, firsts[columns])
    areas = _cut(seen, *here)
    deviations = np.stack([areas.std(axis=(2, 3)), _cut(taught[len(taught) // 2], *there).std(axis=(2, 3))])
    clear = np.minimum(_cut(seen_clear, *here).mean(axis=(2, 3)), _cut(taught_clear, *there).mean(axis=(2, 3)))
    has_say = (1.0 - clear <= _MOST_HIDDEN) & (deviations.max(axis=0) >= _LEAST_DEVIATION)
    is_flat = deviations.min(axis=0) < 1e-3
    for i, k in np.argwhere(has_say):
        if is_flat[i, k]:
            grid[i, columns[k]] = 0.0  # something against nothing
            continue
        rows = slice(max(0, tops[i] - _MOVED_PX[1]), min(height, tops[i] + _AREA_PX + _MOVED_PX[1]))
        first = firsts[columns[k]]
        searched = slice(first - _MOVED_PX[0], first + _AREA_PX + _MOVED_PX[0])
        grid[i, columns[k]] = _best_match(areas[i, k], [one[rows, searched] for one in taught])
    return grid


def _cut(picture: AnyArray, tops: Int64s, lefts: Int64s) -> AnyArray:
    """Return the areas of a picture, (V, U, 12, 12)."""
    windows = np.lib.stride_tricks.sliding_window_view(picture, (_AREA_PX, _AREA_PX))
    return np.ascontiguousarray(windows[np.ix_(tops, lefts)])


def _best_match(area: AnyArray, searched: list[Float32s]) -> float:
    """Return the best correlation of an area within some surroundings."""
    import cv2

    found = [cv2.matchTemplate(np.ascontiguousarray(one), area, cv2.TM_CCOEFF_NORMED) for one in searched]
    return max(float(one.max()) for one in found)
