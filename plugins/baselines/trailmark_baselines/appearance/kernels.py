"""The horizontal shift between two pictures, three ways.

A positive shift: what the second picture shows lies further right than in the first.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trailmark.kernels import kernel
from trailmark.patches import patch_normalised, patch_scores, peak

__all__ = ["column_scores", "patch_normalised", "patch_scores", "peak", "phase_shift"]

_FLAT = 1e-9


@kernel
def column_scores(
    taught: npt.NDArray[np.float64], seen: npt.NDArray[np.float64], max_shift: int
) -> npt.NDArray[np.float64]:
    """Return the correlation of two profiles over what they share, for every shift.

    Parameters
    ----------
    taught, seen : (W,) float64
        Mean brightness of each pixel column.
    max_shift : int
        Largest shift [px], less than W.

    Returns
    -------
    (2 max_shift + 1,) float64
        Pearson correlation; 0 where a profile is flat. Index `max_shift` is no shift.
    """
    width = len(taught)
    scores = np.zeros(2 * max_shift + 1, dtype=np.float64)
    for shift in range(-max_shift, max_shift + 1):
        first, stop = max(0, -shift), min(width, width - shift)
        n = stop - first
        sum_a = sum_b = sum_aa = sum_bb = sum_ab = 0.0
        for u in range(first, stop):
            a, b = taught[u], seen[u + shift]
            sum_a += a
            sum_b += b
            sum_aa += a * a
            sum_bb += b * b
            sum_ab += a * b
        power = (sum_aa - sum_a * sum_a / n) * (sum_bb - sum_b * sum_b / n)
        scores[shift + max_shift] = (sum_ab - sum_a * sum_b / n) / np.sqrt(power) if power > _FLAT else 0.0
    return scores


def phase_shift(taught: npt.NDArray[np.float32], seen: npt.NDArray[np.float32]) -> tuple[float, float]:
    """Return the horizontal shift by phase correlation under a Hann window [px], and the height of its peak."""
    import cv2

    window = cv2.createHanningWindow((taught.shape[1], taught.shape[0]), cv2.CV_32F)
    (right_px, _), response = cv2.phaseCorrelate(taught, seen, window)
    return float(right_px), float(response)
