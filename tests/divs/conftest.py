from __future__ import annotations

import numpy as np
import pytest

from trailmark_divs import averaging, difference, paper_shift, robust_shift


@pytest.fixture(scope="session", autouse=True)
def compiled_kernels():
    """Compile before the first test, so that no property test is charged for it."""
    picture, sums = np.zeros((2, 10), dtype=np.uint8), np.zeros((3, 4), dtype=np.int64)
    histogram = difference.difference_image(picture, picture, picture.copy())
    difference.otsu_threshold(histogram)
    difference.percentile_threshold(histogram, 0.5)
    difference.column_counts(picture, 1, 2, 5)
    difference.column_means(picture, np.full(2, 10), 5)
    averaging.trimmed_windows(sums, 2, 0)
    averaging.mean_windows(sums, 2)
    vector = np.zeros(10)
    paper_shift.hill_climb(paper_shift.winc(vector, vector, 5), 10)
    windows = robust_shift.local_windows(vector, vector == 0, 5)
    robust_shift.shift_scores(windows, windows, 2)
    robust_shift.best_over_shifts(vector[None], vector == 0, windows, 2)
