"""Compiling the kernels before the clock starts."""

from __future__ import annotations

import numpy as np

from trailmark_divs.averaging import mean_windows, trimmed_mean, trimmed_windows
from trailmark_divs.difference import (
    column_counts,
    column_means,
    difference_image,
    otsu_threshold,
    percentile_threshold,
)
from trailmark_divs.paper_shift import hill_climb, winc
from trailmark_divs.robust_shift import best_over_shifts, local_windows, shift_scores, summit
from trailmark_divs.tracking import ShiftTracker

__all__ = ["compile_kernels"]


def compile_kernels() -> None:
    """Call every kernel once with arrays of the types that it meets at work; compiled code is cached on disk."""
    picture = np.zeros((2, 12), dtype=np.uint8)
    histogram = difference_image(picture, picture.copy(), picture.copy())
    otsu_threshold(histogram)
    percentile_threshold(histogram, 0.9)
    sums = column_counts(picture, 0, 3, 4)
    column_means(picture, np.full(3, 8), 4)
    trimmed_mean(np.zeros((4, 3), dtype=np.int64), 1)
    trimmed_windows(np.zeros((4, 3), dtype=np.int64), 4, 1)
    mean_windows(np.zeros((4, 3), dtype=np.int64), 4)
    vector, usable = sums.astype(np.float64), np.ones(3, dtype=np.bool_)
    hill_climb(winc(vector, vector, 3), 3)
    windows = local_windows(vector, usable, 3)
    shift_scores(windows, windows, 0)
    best_over_shifts(vector[None], usable, windows, 0)
    summit(vector, 1, 1)
    ShiftTracker(1, 25).update(np.zeros(3))
