"""The horizontal shift between two pictures, three ways.

A positive shift: what the second picture shows lies further right than in the first.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trailmark.kernels import kernel

__all__ = ["column_scores", "patch_normalised", "patch_scores", "peak", "phase_shift"]

_FLAT = 1e-9
_PATCH_CLIP = 1.0


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


def patch_normalised(picture: npt.NDArray[np.uint8], patch_px: int) -> npt.NDArray[np.float32]:
    """Return a picture with every pixel normalised by its patch: zero mean, unit deviation, clipped to [-1, 1].

    Patches at the edge are those pixels of them that lie in the picture; where a patch is flat, the result is 0.
    """
    grey = picture.astype(np.float64)
    n = _box_sum(np.ones_like(grey), patch_px)
    mean = _box_sum(grey, patch_px) / n
    deviation = np.sqrt(np.maximum(_box_sum(grey * grey, patch_px) / n - mean * mean, 0.0))
    normal = np.divide(grey - mean, deviation, out=np.zeros_like(grey), where=deviation > 1e-6)
    return np.asarray(np.clip(normal, -_PATCH_CLIP, _PATCH_CLIP), dtype=np.float32)


def _box_sum(values: npt.NDArray[np.float64], side_px: int) -> npt.NDArray[np.float64]:
    """Return the sum around every pixel; beyond the edge there is nothing."""
    import cv2

    size = (side_px, side_px)
    return np.asarray(cv2.boxFilter(values, -1, size, normalize=False, borderType=cv2.BORDER_CONSTANT))


def patch_scores(taught: npt.NDArray[np.float32], seen: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
    """Return the correlation of two small pictures for shifts of up to half their width.

    The present picture is padded with zeros by half its width at both sides, and the whole taught one slides over it.

    Returns
    -------
    (2 (w // 2) + 1,) float64
        Correlation; index ``w // 2`` is no shift.
    """
    import cv2

    half = taught.shape[1] // 2
    padded = np.pad(seen, ((0, 0), (half, half)))
    return np.asarray(cv2.matchTemplate(padded, taught, cv2.TM_CCOEFF_NORMED)[0], dtype=np.float64)


def phase_shift(taught: npt.NDArray[np.float32], seen: npt.NDArray[np.float32]) -> tuple[float, float]:
    """Return the horizontal shift by phase correlation under a Hann window [px], and the height of its peak."""
    import cv2

    window = cv2.createHanningWindow((taught.shape[1], taught.shape[0]), cv2.CV_32F)
    (right_px, _), response = cv2.phaseCorrelate(taught, seen, window)
    return float(right_px), float(response)


def peak(scores: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Return where scores peak, as a shift from their middle with a fraction from a parabola, and the highest."""
    top = int(np.argmax(scores))
    shift = float(top - len(scores) // 2)
    if 0 < top < len(scores) - 1:
        left, centre, right = scores[top - 1 : top + 2].tolist()
        curvature = left - 2.0 * centre + right
        if curvature < 0.0:
            shift += 0.5 * (left - right) / curvature
    return shift, float(scores[top])
