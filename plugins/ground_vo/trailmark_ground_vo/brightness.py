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

from trailmark.arrays import Float32s, Grey8
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

#: What a smooth curve leaves of a step, at least [1], and over what it leaves at most places: 9 to 45 of
#: the edge of a shadow that takes 30 to 60 % of the light, up to 8 of lamps whose light swings by 10 to 60 %.
_LEAST_BEND, _BEND_OVER_MEDIAN = 0.04, 9.0

#: Of 255, what is left of a cell that can be measured beside what is foreign.
_LEAST_KEPT = 85.0

#: Standard deviation of a median of n over the median of the absolute deviations from it, times sqrt(n).
_SIGMA_OF_MEDIAN = 1.4826 * 1.2533

#: A median is known no better than by the steps of grey levels [1].
_LEAST_SIGMA = 1e-3

#: Steps of the brightness from cell to cell, smoothed so widely [cells], from which on it is an edge of the light, and
#: beyond which nothing is seen of the ground there; that of ground changes by up to 0.055, behind marks by 0.067 (five
#: floors), at the edge of a shadow that takes half the light by 0.16 [1].
_EDGE_CELLS, _STEEP, _STEEPEST = 1.5, 0.07, 0.1

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
    means = cell_means(image, side) if foreign is None else _means_beside(image, foreign, side)
    cells = cv2.medianBlur(means, _MEDIAN_CELLS).astype(np.float32)  # no drop, but a shadow's edge
    around = np.asarray(cv2.GaussianBlur(cells, (0, 0), _AROUND_CELLS), np.float32)
    # a filter flattens the bends of the light; what it leaves of them is filtered and added (Tukey's twicing)
    around += cv2.GaussianBlur(cv2.medianBlur(cells - around, _BEND_CELLS), (0, 0), _AROUND_CELLS)
    shares = _shares_of_bands(means, around)
    for axis, share in enumerate(shares):
        if share > 0.0:
            around *= _medians(_ratios(means, around), axis) ** np.float32(share)
    excess = cells - around
    around += excess - np.clip(excess, -_MOST_DIFFERENT * around, _MOST_DIFFERENT * around)
    gain = GAIN_ONE * np.minimum(np.float32(_MOST_GAIN), EVEN_LEVEL / np.maximum(around, np.float32(1.0)))
    size = (image.shape[1], image.shape[0])
    even = flatten(image, np.asarray(cv2.resize((gain + 0.5).astype(np.uint16), size), np.uint16))
    weights = _weights_beside_edges(means, shares)
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


def _means_beside(image: Grey8, foreign: Grey8, side: int) -> Grey8:
    """Return the means of cells without what is foreign; cells that hardly have anything else have it."""
    own = np.bitwise_not(foreign)
    kept = cell_means(own, side).astype(np.float32)
    known = 255.0 * cell_means(np.bitwise_and(image, own), side) / np.maximum(kept, np.float32(1.0))
    return np.asarray(np.where(kept >= _LEAST_KEPT, np.minimum(known + 0.5, 255.0), cell_means(image, side)), np.uint8)


def _shares_of_bands(means: Grey8, around: Float32s) -> list[float]:
    """Return how much of what rows, and columns, of cells have in common is light, 0 to 1: beyond what ground scatters.

    A shutter that rolls on for longer than half a swing of the lamps makes bands too narrow for a filter that looks the
    same way in all directions. The share grows slowly, so that two pictures of the same are treated alike.
    """
    ratios, shares = _ratios(means, around), []
    for axis in (0, 1):
        if _has_a_step(_medians(means.astype(np.float32), axis)):
            shares.append(0.0)  # the edge of a shadow that lies along the rows is no band
            continue
        middle = _medians(ratios, axis)
        scatter = _medians(np.abs(ratios - middle), axis) / math.sqrt(ratios.shape[1 - axis])
        sigmas = (middle - 1.0) / np.maximum(_SIGMA_OF_MEDIAN * scatter, _LEAST_SIGMA)
        rms = math.sqrt(float(np.mean(sigmas**2)))
        shares.append(min(1.0, max(0.0, (rms - _LEAST_BANDS) / (_MOST_BANDS - _LEAST_BANDS))))
    return shares


def _has_a_step(profile: Float32s) -> bool:
    """Return whether a profile, (n, 1) or (1, n), bends at one place far more than at all others, as no wave does."""
    logs = np.log(np.maximum(profile.reshape(-1, 1), np.float32(1.0)))
    left = logs - cv2.GaussianBlur(logs, (1, 7), sigmaX=1.0)
    bends = np.abs(left - cv2.GaussianBlur(left, (1, 7), sigmaX=1.0))[1:-1]
    return float(bends.max()) > max(_LEAST_BEND, _BEND_OVER_MEDIAN * float(np.median(bends)))


def _weights_beside_edges(means: Grey8, shares: Sequence[float]) -> Grey8:
    """Return 255 for cells, less where the light changes steeply, 0 along an edge; bands are no edges."""
    light = cv2.medianBlur(means, _BEND_CELLS).astype(np.float32)  # no mark on the lens, no crack in the ground
    logs = np.log(np.maximum(cv2.GaussianBlur(light, (0, 0), _EDGE_CELLS), np.float32(1.0)))
    for axis, share in enumerate(shares):
        if share > 0.0:
            logs -= np.float32(share) * _medians(logs, axis)
    down, right = np.gradient(logs)
    left = (_STEEPEST - np.hypot(down, right)) / (_STEEPEST - _STEEP)
    return np.asarray(255.0 * np.clip(left, 0.0, 1.0), np.uint8)


def _ratios(means: Grey8, around: Float32s) -> Float32s:
    return np.asarray(means.astype(np.float32) / np.maximum(around, np.float32(1.0)), np.float32)


def _medians(cells: Float32s, axis: int) -> Float32s:
    """Return the median of each row (axis 0) or column, to be spread over it."""
    return np.asarray(np.median(cells, axis=1 - axis, keepdims=True), np.float32)
