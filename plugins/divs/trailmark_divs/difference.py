"""Kernels of the stream: difference image, threshold, column sums (Eqs. 4, 5 and 7)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trailmark.kernels import kernel

__all__ = ["column_counts", "column_means", "difference_image", "otsu_threshold", "percentile_threshold"]

_LEVELS = 256
_FLOAT_EPSILON = 1.1920929e-07  # OpenCV's guard against an empty class, kept so that thresholds agree with it


@kernel
def difference_image(
    previous: npt.NDArray[np.uint8], current: npt.NDArray[np.uint8], difference: npt.NDArray[np.uint8]
) -> npt.NDArray[np.int64]:
    """Write ``|previous - current|`` into `difference` and return its histogram, Eq. (4).

    Parameters
    ----------
    previous, current, difference : (H, W) uint8
        Two grey pictures, and where the difference goes.

    Returns
    -------
    (256,) int64
        Pixels of each difference.
    """
    height, width = previous.shape
    for v in range(height):
        for u in range(width):
            before, now = previous[v, u], current[v, u]
            difference[v, u] = before - now if before > now else now - before
    # Four tables: equal neighbours would otherwise wait for each other's increment.
    tables = np.zeros((4, _LEVELS), dtype=np.int32)
    flat = difference.ravel()
    whole = len(flat) // 4 * 4
    for i in range(0, whole, 4):
        tables[0, flat[i]] += 1
        tables[1, flat[i + 1]] += 1
        tables[2, flat[i + 2]] += 1
        tables[3, flat[i + 3]] += 1
    for i in range(whole, len(flat)):
        tables[0, flat[i]] += 1
    histogram = np.zeros(_LEVELS, dtype=np.int64)
    for table in range(4):
        for level in range(_LEVELS):
            histogram[level] += tables[table, level]
    return histogram


@kernel
def otsu_threshold(histogram: npt.NDArray[np.int64]) -> int:
    """Return the level that separates a histogram best, Otsu 1979; pixels above it have changed, Eq. (5).

    The first of equal maxima wins, as in OpenCV. A histogram of a single level gives 0.
    """
    total = 0
    weighted = 0.0
    for level in range(_LEVELS):
        total += histogram[level]
        weighted += level * histogram[level]
    if total == 0:
        return 0
    mean = weighted / total
    share_below, mean_below = 0.0, 0.0
    best, best_variance = 0, 0.0
    for level in range(_LEVELS):
        share = histogram[level] / total
        mean_below *= share_below
        share_below += share
        share_above = 1.0 - share_below
        if min(share_below, share_above) < _FLOAT_EPSILON or max(share_below, share_above) > 1.0 - _FLOAT_EPSILON:
            continue
        mean_below = (mean_below + level * share) / share_below
        mean_above = (mean - share_below * mean_below) / share_above
        variance = share_below * share_above * (mean_below - mean_above) ** 2
        if variance > best_variance:
            best, best_variance = level, variance
    return best


@kernel
def percentile_threshold(histogram: npt.NDArray[np.int64], share: float) -> int:
    """Return the smallest level that at least `share` of the pixels do not exceed."""
    total = 0
    for level in range(_LEVELS):
        total += histogram[level]
    below = 0
    for level in range(_LEVELS):
        below += histogram[level]
        if below >= share * total:
            return level
    return _LEVELS - 1


@kernel
def column_counts(
    difference: npt.NDArray[np.uint8], threshold: int, n_columns: int, column_px: int
) -> npt.NDArray[np.int64]:
    """Count the pixels above the threshold in each column, Eqs. (5) and (7).

    Parameters
    ----------
    difference : (H, W) uint8
        Absolute difference of two pictures [grey levels].
    threshold : int
        Differences above it count as a change [grey levels].
    n_columns : int
        How many columns, d.
    column_px : int
        Width of a column [px].

    Returns
    -------
    (d,) int64
        Changed pixels of each column.
    """
    height = difference.shape[0]
    used = n_columns * column_px
    per_pixel = np.zeros(used, dtype=np.int32)
    for v in range(height):
        for u in range(used):
            per_pixel[u] += np.int32(difference[v, u] > threshold)
    counts = np.zeros(n_columns, dtype=np.int64)
    for column in range(n_columns):
        for u in range(column * column_px, (column + 1) * column_px):
            counts[column] += per_pixel[u]
    return counts


@kernel
def column_means(grey: npt.NDArray[np.uint8], area: npt.NDArray[np.int64], column_px: int) -> npt.NDArray[np.float64]:
    """Return the mean brightness of each column, (d,) [grey levels]; masked pixels must be 0 in `grey`."""
    height = grey.shape[0]
    used = len(area) * column_px
    per_pixel = np.zeros(used, dtype=np.int32)
    for v in range(height):
        for u in range(used):
            per_pixel[u] += np.int32(grey[v, u])
    means = np.zeros(len(area), dtype=np.float64)
    for column in range(len(area)):
        total = 0
        for u in range(column * column_px, (column + 1) * column_px):
            total += per_pixel[u]
        means[column] = total / area[column] if area[column] > 0 else 0.0
    return means
