"""Kernel: how well the areas of one small picture are found in others."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Bools, Float32s, Floats

__all__ = ["area_fits"]

_AREA_PX, _AREA_STEP_PX = 12, 6
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
    import cv2

    aside_px, up_px = _MOVED_PX
    height, width = seen.shape
    middle = taught[len(taught) // 2]
    fits = []
    for v in range(0, height - _AREA_PX + 1, _AREA_STEP_PX):
        rows = slice(v, v + _AREA_PX)
        searched_rows = slice(max(0, v - up_px), min(height, v + _AREA_PX + up_px))
        for u in range(0, width - _AREA_PX + 1, _AREA_STEP_PX):
            first = u - shift_px
            if first < aside_px or first + _AREA_PX + aside_px > width:
                continue
            area, there = seen[rows, u : u + _AREA_PX], middle[rows, first : first + _AREA_PX]
            hidden = max(
                1.0 - seen_clear[rows, u : u + _AREA_PX].mean(),
                1.0 - taught_clear[rows, first : first + _AREA_PX].mean(),
            )
            if hidden > _MOST_HIDDEN or max(float(area.std()), float(there.std())) < _LEAST_DEVIATION:
                continue
            if min(float(area.std()), float(there.std())) < 1e-3:
                fits.append(0.0)  # something against nothing
                continue
            columns = slice(first - aside_px, first + _AREA_PX + aside_px)
            template = np.ascontiguousarray(area)
            found = [
                cv2.matchTemplate(np.ascontiguousarray(one[searched_rows, columns]), template, cv2.TM_CCOEFF_NORMED)
                for one in taught
            ]
            fits.append(float(np.max(found)))
    return np.array(fits, dtype=np.float64)
