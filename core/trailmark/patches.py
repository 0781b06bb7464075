"""Small pictures, every pixel normalised by its patch, and the horizontal shift between two of them.

The method of Dall'Osto, Fischer & Milford (2021): what is left of a picture is where it is brighter and darker than its
surroundings, so that light which changes slowly over the picture does not matter.
"""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Float32s, Floats, Grey8

__all__ = ["PATCH_PX", "SMALL_PX", "patch_normalised", "patch_scores", "peak", "small_picture"]

#: Width and height of a small picture, and the side of a patch [px].
SMALL_PX = (115, 44)
PATCH_PX = 9
_PATCH_CLIP = 1.0


def small_picture(grey: Grey8, size_px: tuple[int, int] = SMALL_PX, patch_px: int = PATCH_PX) -> Float32s:
    """Return the small normalised picture, (h, w) in [-1, 1]; `size_px` is its width and height."""
    import cv2

    return patch_normalised(np.asarray(cv2.resize(grey, size_px, interpolation=cv2.INTER_AREA), np.uint8), patch_px)


def patch_normalised(picture: Grey8, patch_px: int) -> Float32s:
    """Return a picture with every pixel normalised by its patch: zero mean, unit deviation, clipped to [-1, 1].

    Patches at the edge are those pixels of them that lie in the picture; where a patch is flat, the result is 0.
    """
    grey = picture.astype(np.float64)
    n = _box_sum(np.ones_like(grey), patch_px)
    mean = _box_sum(grey, patch_px) / n
    deviation = np.sqrt(np.maximum(_box_sum(grey * grey, patch_px) / n - mean * mean, 0.0))
    normal = np.divide(grey - mean, deviation, out=np.zeros_like(grey), where=deviation > 1e-6)
    return np.asarray(np.clip(normal, -_PATCH_CLIP, _PATCH_CLIP), dtype=np.float32)


def _box_sum(values: Floats, side_px: int) -> Floats:
    """Return the sum around every pixel; beyond the edge there is nothing."""
    import cv2

    size = (side_px, side_px)
    return np.asarray(cv2.boxFilter(values, -1, size, normalize=False, borderType=cv2.BORDER_CONSTANT))


def patch_scores(taught: Float32s, seen: Float32s) -> Floats:
    """Return the correlation of two small pictures for shifts of up to half their width.

    The present picture is padded with zeros by half its width at both sides, and the whole taught one slides over it.
    A positive shift: what the present picture shows lies further right than in the taught one.

    Returns
    -------
    (2 (w // 2) + 1,) float64
        Correlation; index ``w // 2`` is no shift.
    """
    import cv2

    half = taught.shape[1] // 2
    padded = np.pad(seen, ((0, 0), (half, half)))
    return np.asarray(cv2.matchTemplate(padded, taught, cv2.TM_CCOEFF_NORMED)[0], dtype=np.float64)


def peak(scores: Floats) -> tuple[float, float]:
    """Return where scores peak, as a shift from their middle with a fraction from a parabola, and the highest."""
    top = int(np.argmax(scores))
    shift = float(top - len(scores) // 2)
    if 0 < top < len(scores) - 1:
        left, centre, right = scores[top - 1 : top + 2].tolist()
        curvature = left - 2.0 * centre + right
        if curvature < 0.0:
            shift += 0.5 * (left - right) / curvature
    return shift, float(scores[top])
