"""Shift by local normalised cross-correlation: bounded, sub-column, antisymmetric.

Where the reference divides by the largest magnitude and lets the vectors wrap around, here every window of
both vectors has zero mean and unit norm, and only windows that lie inside both are compared.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trailmark.kernels import kernel

__all__ = ["best_over_shifts", "local_windows", "shift_scores", "summit"]

_FLAT = 1e-9  # norm below which a window holds no pattern


@kernel
def local_windows(
    vector: npt.NDArray[np.float64], usable: npt.NDArray[np.bool_], window: int
) -> npt.NDArray[np.float64]:
    """Return every window of a change vector with zero mean and unit norm.

    Parameters
    ----------
    vector : (d,) float64
        Change vector.
    usable : (d,) bool
        Columns that may be compared; a window with any other is zero.
    window : int
        Length of a window, e.

    Returns
    -------
    (d - e + 1, e) float64
        The windows; zero where there is no pattern.
    """
    n_windows = len(vector) - window + 1
    windows = np.zeros((n_windows, window), dtype=np.float64)
    for start in range(n_windows):
        mean, is_usable = 0.0, True
        for m in range(window):
            mean += vector[start + m]
            is_usable &= usable[start + m]
        if not is_usable:
            continue
        mean /= window
        squares = 0.0
        for m in range(window):
            windows[start, m] = vector[start + m] - mean
            squares += windows[start, m] ** 2
        norm = np.sqrt(squares)
        for m in range(window):
            windows[start, m] = windows[start, m] / norm if norm > _FLAT else 0.0
    return windows


@kernel
def shift_scores(
    taught: npt.NDArray[np.float64], seen: npt.NDArray[np.float64], max_shift: int
) -> npt.NDArray[np.float64]:
    """Correlation of two change vectors for every shift of at most `max_shift` columns.

    The sum of the windows' correlations over ``sqrt(pairs at this shift * pairs at no shift)``: halfway between
    their mean, which trusts a few lucky windows at the edge, and their sum, which pulls towards no shift.
    Swapping the arguments reverses the result.

    Parameters
    ----------
    taught, seen : (n, e) float64
        `local_windows` of the teach and the replay vector.
    max_shift : int
        Largest shift [columns], less than n.

    Returns
    -------
    (2 max_shift + 1,) float64
        In [-1, 1]; index `max_shift` is no shift.
    """
    n_windows, window = taught.shape
    scores = np.zeros(2 * max_shift + 1, dtype=np.float64)
    for shift in range(-max_shift, max_shift + 1):
        first, stop = max(0, -shift), min(n_windows, n_windows - shift)
        total = 0.0
        for start in range(first, stop):
            for m in range(window):
                total += taught[start, m] * seen[start + shift, m]
        scores[shift + max_shift] = total / np.sqrt((stop - first) * n_windows)
    return scores


@kernel
def best_over_shifts(
    vectors: npt.NDArray[np.float64],
    usable: npt.NDArray[np.bool_],
    seen: npt.NDArray[np.float64],
    max_shift: int,
) -> npt.NDArray[np.float64]:
    """Return the best score of one replay vector with each of many teach vectors, whatever the shift.

    Parameters
    ----------
    vectors : (M, d) float64
        Teach change vectors.
    usable : (d,) bool
        Columns that may be compared.
    seen : (n, e) float64
        `local_windows` of the replay vector.

    Returns
    -------
    (M,) float64
        Best score of each.
    """
    best = np.empty(vectors.shape[0], dtype=np.float64)
    for k in range(vectors.shape[0]):
        taught = local_windows(vectors[k], usable, seen.shape[1])
        best[k] = shift_scores(taught, seen, max_shift).max()
    return best


@kernel
def summit(scores: npt.NDArray[np.float64], index: int, reach: int = 0) -> float:
    """Return where the scores peak near an index, to a fraction of a column, as an index.

    A parabola through the highest of the scores within `reach` of the index and its neighbours; at an end of
    the array, the end itself.
    """
    top = max(0, index - reach)
    for place in range(top, min(len(scores), index + reach + 1)):
        if scores[place] > scores[top]:
            top = place
    if top == 0 or top == len(scores) - 1:
        return float(top)
    slope = (scores[top - 1] - scores[top + 1]) / 2.0
    curvature = scores[top - 1] - 2.0 * scores[top] + scores[top + 1]
    if curvature >= 0.0:
        return float(top)
    return float(top + min(max(slope / curvature, -0.5), 0.5))
