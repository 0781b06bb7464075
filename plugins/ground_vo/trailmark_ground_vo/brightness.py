"""The picture in even light: every pixel relative to how bright its surroundings are.

Lamps flicker, shadows wander, lenses darken towards the corners. A pixel of the ground then has another grey level in
each picture, but hardly another ratio to its surroundings. The brightness of the surroundings is taken from the
picture itself, at a sixteenth of the resolution, so that nothing has to be learned or forgotten.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from trailmark.arrays import Float32s, Floats, Grey8
from trailmark_ground_vo.filters import GAIN_ONE, cell_means, flatten

__all__ = ["EVEN_LEVEL", "even_brightness", "fade_pixels"]

#: Grey level of a pixel that is as bright as its surroundings.
EVEN_LEVEL = 128

#: Side of the cells in which the surroundings are looked at, at most and at least [px], and how many of them lie across
#: a smaller picture: light, such as the bands of lamps on mains, is as wide as the picture, not as so many pixels.
_CELL_PX, _LEAST_CELL_PX, _CELLS_ACROSS = 16, 4, 30

#: Width of the surroundings: of a median, and standard deviation of a Gauss filter [cells].
_MEDIAN_CELLS, _AROUND_CELLS = 3, 2.0

#: Width of a median of what that leaves of the light: what bends only here is a mark or a drop [cells].
_BEND_CELLS = 5

#: Rows or columns of cells are the bands of lamps on mains under a rolling shutter where their medians differ by more
#: than so many of their own standard deviations (rms), and all of what differs is; those of ground do by up to 1.6,
#: behind marks as well (five floors), under lamps by 3 to 15.
_LEAST_BANDS, _MOST_BANDS = 2.5, 4.5

#: Share of a cell that has to be left, so that it is measured beside what is foreign.
_LEAST_KEPT = 0.3

#: Standard deviation of a median of n over the median of the absolute deviations from it, times sqrt(n).
_SIGMA_OF_MEDIAN = 1.4826 * 1.2533

#: A median is known no better than by the steps of grey levels [1].
_LEAST_SIGMA = 1e-3

#: Steps of the brightness from cell to cell, smoothed so widely [cells], from which on it may be an edge of the light,
#: and beyond which it surely is as steep as one; that of ground changes by up to 0.055, behind marks by 0.067 (five
#: floors), at the edge of a shadow that takes half the light by 0.16 [1].
_EDGE_CELLS, _STEEP, _STEEPEST = 1.5, 0.07, 0.1

#: What a smooth filter leaves in so many cells, from which on it is an edge: 0.12 to 0.34 at that of a shadow that
#: takes 30 to 60 % of the light, up to 0.1 in the light of a lamp as wide as a quarter of the picture [1].
_EDGE_SIDE, _BENT, _MOST_BENT = 5, 0.07, 0.12

#: Cells that differ more than this from their surroundings are lit differently: only so much of it is ground [1].
_MOST_DIFFERENT = 0.1

#: The largest gain: what is darker stays dark, or a black picture would be nothing but noise.
_MOST_GAIN = 8.0


def even_brightness(image: Grey8, foreign: Grey8 | None = None) -> Grey8:
    """Return `EVEN_LEVEL` times the picture over the brightness around each pixel, (H, W) uint8.

    Along an edge of the light, as that of a shadow, the surroundings are of two kinds, and what is left of it is no
    ground: there it is faded to `EVEN_LEVEL`.

    Parameters
    ----------
    image : (H, W) uint8
        As it came from the camera.
    foreign : (H, W) uint8, optional
        255 where something is seen that is neither ground nor light: the surroundings are measured beside it.
    """
    shorter = min(image.shape)
    side = min(shorter, max(_LEAST_CELL_PX, min(_CELL_PX, shorter // _CELLS_ACROSS)))
    means = cell_means(image, side)
    if foreign is not None:
        means = _means_beside(image, foreign, means, side)
    cells = cv2.medianBlur(means, _MEDIAN_CELLS).astype(np.float32)  # no drop, but a shadow's edge
    around = np.asarray(cv2.GaussianBlur(cells, (0, 0), _AROUND_CELLS), np.float32)
    # a filter flattens the bends of the light; what it leaves of them is filtered and added (Tukey's twicing)
    around += cv2.GaussianBlur(cv2.medianBlur(cells - around, _BEND_CELLS), (0, 0), _AROUND_CELLS)
    shares = _shares_of_bands(means, around)
    for axis, share in enumerate(shares):
        if share > 0.0:
            around *= _medians(_ratios(means, around), axis) ** np.float32(share)
    excess = cells - around
    weights = _weights_beside_edges(means, np.abs(excess) / np.maximum(around, np.float32(1.0)), shares)
    around += excess - np.clip(excess, -_MOST_DIFFERENT * around, _MOST_DIFFERENT * around)
    gain = GAIN_ONE * np.minimum(np.float32(_MOST_GAIN), EVEN_LEVEL / np.maximum(around, np.float32(1.0)))
    size = (image.shape[1], image.shape[0])
    even = flatten(image, np.asarray(cv2.resize((gain + 0.5).astype(np.uint16), size), np.uint16))
    return even if weights.min() == 255 else fade_pixels(even, np.asarray(cv2.resize(weights, size), np.uint8))


def fade_pixels(even: Grey8, weights: Grey8) -> Grey8:
    """Return a picture in even light with some pixels faded to `EVEN_LEVEL`.

    Parameters
    ----------
    even : (H, W) uint8
        Of `even_brightness`.
    weights : (H, W) uint8
        From 0, neutral, to 255, as it is.
    """
    apart = (even.astype(np.int16) - EVEN_LEVEL) * weights  # at most 128 * 255, which 16 bits just hold
    return np.asarray(EVEN_LEVEL + (apart >> 8) + (apart > 0), np.uint8)


def _means_beside(image: Grey8, foreign: Grey8, means: Grey8, side: int) -> Grey8:
    """Return the means of cells without what is foreign; cells that hardly have anything else have all of it."""
    rows, columns = means.shape
    own = (foreign[: rows * side, : columns * side] == 0).astype(np.float32)
    kept, known = (
        cv2.resize(picture, (columns, rows), interpolation=cv2.INTER_AREA)
        for picture in (own, own * image[: rows * side, : columns * side])
    )
    beside = np.rint(known / np.maximum(kept, np.float32(1e-3)))
    return np.asarray(np.where(kept >= _LEAST_KEPT, beside, means), np.uint8)


def _shares_of_bands(means: Grey8, around: Float32s) -> list[float]:
    """Return how much of what rows, and columns, of cells have in common is light, 0 to 1: beyond what ground scatters.

    A shutter that rolls on for longer than half a swing of the lamps makes bands too narrow for a filter that looks the
    same way in all directions. The share grows slowly, so that two pictures of the same are treated alike.
    """
    ratios, shares = _ratios(means, around), []
    for axis in (0, 1):
        middle = _medians(ratios, axis)
        scatter = _medians(np.abs(ratios - middle), axis) / math.sqrt(ratios.shape[1 - axis])
        sigmas = (middle - 1.0) / np.maximum(_SIGMA_OF_MEDIAN * scatter, _LEAST_SIGMA)
        rms = math.sqrt(float(np.mean(sigmas**2)))
        shares.append(min(1.0, max(0.0, (rms - _LEAST_BANDS) / (_MOST_BANDS - _LEAST_BANDS))))
    return shares


def _weights_beside_edges(means: Grey8, unexplained: Float32s, shares: Sequence[float]) -> Grey8:
    """Return 255 for cells, 0 along an edge: where the light changes steeply, and more so than a smooth filter follows.

    A headlamp is steep and smooth, a mark and a crack are neither smooth nor steep over several cells, and bands, less
    their share, are no edges.
    """
    if min(means.shape) < 2:
        return np.full(means.shape, 255, np.uint8)
    light = cv2.medianBlur(means, _BEND_CELLS).astype(np.float32)
    logs = np.log(np.maximum(cv2.GaussianBlur(light, (0, 0), _EDGE_CELLS), np.float32(1.0)))
    for axis, share in enumerate(shares):
        if share > 0.0:
            logs -= np.float32(share) * _medians(logs, axis)
    down, right = np.gradient(logs)
    side = np.ones((_EDGE_SIDE, _EDGE_SIDE), np.uint8)
    beside = np.asarray(cv2.dilate(unexplained, side), np.float32)  # what lies on the edge itself is explained
    even = np.maximum(_falling(np.hypot(down, right), _STEEP, _STEEPEST), _falling(beside, _BENT, _MOST_BENT))
    return np.asarray(255.0 * even, np.uint8)


def _falling(values: Floats | Float32s, least: float, most: float) -> Floats:
    """Return 1 for values up to the least, 0 from the most on, and what falls evenly between."""
    return np.asarray(np.clip((most - values) / (most - least), 0.0, 1.0), np.float64)


def _ratios(means: Grey8, around: Float32s) -> Float32s:
    return np.asarray(means.astype(np.float32) / np.maximum(around, np.float32(1.0)), np.float32)


def _medians(cells: Float32s, axis: int) -> Float32s:
    """Return the median of each row (axis 0) or column, to be spread over it."""
    return np.asarray(np.median(cells, axis=1 - axis, keepdims=True), np.float32)
