"""Kernels: the average of differences over a window, Eq. (6), plain or trimmed."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trailmark.kernels import kernel

__all__ = ["mean_windows", "trimmed_mean", "trimmed_windows"]


@kernel
def trimmed_mean(sums: npt.NDArray[np.int64], n_trimmed: int) -> npt.NDArray[np.float64]:
    """Mean of each column without its `n_trimmed` smallest and largest values.

    What crosses the view for a short time (a person, a car) changes a column a lot in a few differences:
    the plain mean of Eq. (6) carries them on, the trimmed one leaves them out.

    Parameters
    ----------
    sums : (w, d) int64
        Column sums of w differences, in any order.
    n_trimmed : int
        Values left out at each end, fewer than w / 2.

    Returns
    -------
    (d,) float64
        Change vector.
    """
    window, n_columns = sums.shape
    vector = np.empty(n_columns, dtype=np.float64)
    ordered = np.empty(window, dtype=np.int64)
    for column in range(n_columns):
        for k in range(window):  # insertion sort: windows are short, and nearly constant columns cost O(w)
            value = sums[k, column]
            place = k
            while place > 0 and ordered[place - 1] > value:
                ordered[place] = ordered[place - 1]
                place -= 1
            ordered[place] = value
        total = 0
        for k in range(n_trimmed, window - n_trimmed):
            total += ordered[k]
        vector[column] = total / (window - 2 * n_trimmed)
    return vector


@kernel
def trimmed_windows(sums: npt.NDArray[np.int64], window: int, n_trimmed: int) -> npt.NDArray[np.float64]:
    """Return the trimmed change vector of every window of a recording, (N - w + 1, d)."""
    n_windows = sums.shape[0] - window + 1
    vectors = np.empty((n_windows, sums.shape[1]), dtype=np.float64)
    for k in range(n_windows):
        vectors[k] = trimmed_mean(sums[k : k + window], n_trimmed)
    return vectors


@kernel
def mean_windows(sums: npt.NDArray[np.int64], window: int) -> npt.NDArray[np.float64]:
    """Return the change vector of every window of a recording by running sums, Eq. (6), (N - w + 1, d)."""
    n_windows, n_columns = sums.shape[0] - window + 1, sums.shape[1]
    vectors = np.empty((n_windows, n_columns), dtype=np.float64)
    total = np.zeros(n_columns, dtype=np.int64)
    for k in range(window):
        total += sums[k]
    vectors[0] = total / window
    for k in range(1, n_windows):
        total += sums[k + window - 1] - sums[k - 1]
        vectors[k] = total / window
    return vectors
