"""Consensus of sub-areas: a share of the picture may show something else than the ground, and say so.

Steep pixels have the say in an alignment, and what lies on the ground, hangs into the picture or hovers over it is
often steeper than the ground. So every sub-area of the picture gets one vote: the shift by which it would leave the
common motion. Those that would leave it by more than the others are left out, and the scatter of the rest tells how
well the motion is known, whatever the noise is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Bools, Float32s, Floats, Int64s
from trailmark.kernels import float_kernel, inner_kernel, kernel
from trailmark_ground_vo.extremes import Area
from trailmark_ground_vo.few_numbers import median_of
from trailmark_ground_vo.texture import SLOPE_U, SLOPE_V, VALUE, Texture, X, Y

__all__ = ["N_SIDE", "Consensus", "areas_of", "consensus_of", "relit"]

#: Sub-areas along each side.
N_SIDE = 5

#: A sub-area that would leave by this much, or by so many times the median, has another motion [px].
_LEAST_STRAY_PX, _STRAY_FACTOR = 0.5, 5.0

#: Standard deviations of its own shift that a sub-area may stray by; neighbouring pixels share their noise.
_OWN_SIGMAS = 10.0

#: A shift of more than this says only that it is not the common one [px].
_MOST_STRAY_PX = 3.0

#: Pixels that a sub-area needs for a vote.
_LEAST_PIXELS = 12

#: Gains of a sub-area's contrast that are believed, and how much of its contrast noise may be [1].
_GAINS = (0.3, 3.0)

#: Least second eigenvalue of a sub-area's curvature, of the median of all: along a grain it has no vote.
_LEAST_SHARE = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Consensus:
    """What the sub-areas say of a motion.

    Attributes
    ----------
    agrees : (25,) bool
        Sub-areas that do not leave it.
    n_voting : int
        Those that have enough pixels to tell.
    scatter : (3, 3) float64
        Sum of the outer products of the agreeing areas' gradients: what the cost function's noise is.
    """

    agrees: Bools
    n_voting: int
    scatter: Floats

    @property
    def share(self) -> float:
        """Share of the voting sub-areas that agree."""
        return float(np.count_nonzero(self.agrees)) / max(1, self.n_voting)


@float_kernel
def areas_of(texture: Texture, area: Area) -> Int64s:
    """Return the sub-area of each pixel, (N,) int64."""
    left, top, right, bottom = area
    out = np.empty(texture.shape[1], np.int64)
    for n in range(texture.shape[1]):
        column = int((texture[X, n] - left) * N_SIDE / (right - left))
        row = int((texture[Y, n] - top) * N_SIDE / (bottom - top))
        out[n] = min(max(row, 0), N_SIDE - 1) * N_SIDE + min(max(column, 0), N_SIDE - 1)
    return out


@float_kernel
def _equations(
    texture: Texture,
    differences: Float32s,
    slopes: tuple[Float32s, Float32s],
    areas: Int64s,
    centre: tuple[float, float],
    huber: float,
) -> Floats:
    """Return uu, uv, vv, ru, rv, rt, the squares and the number of pixels of each area, (25, 8)."""
    out = np.zeros((N_SIDE * N_SIDE, 8), np.float64)
    limit, least, one = np.float32(huber), np.float32(1e-3), np.float32(1.0)
    for n in range(texture.shape[1]):
        a, slope_u, slope_v = areas[n], slopes[0][n], slopes[1][n]
        dx, dy = texture[X, n] - np.float32(centre[0]), texture[Y, n] - np.float32(centre[1])
        difference = differences[n]
        weight = min(one, limit / max(abs(difference), least))
        weighted = weight * difference
        out[a, 0] += weight * slope_u * slope_u
        out[a, 1] += weight * slope_u * slope_v
        out[a, 2] += weight * slope_v * slope_v
        out[a, 3] -= weighted * slope_u
        out[a, 4] -= weighted * slope_v
        out[a, 5] -= weighted * (slope_u * dy - slope_v * dx)
        out[a, 6] += weighted * difference
        out[a, 7] += 1.0
    return out


def consensus_of(
    texture: Texture,
    differences: Float32s,
    slopes: tuple[Float32s, Float32s],
    *,
    areas: Int64s,
    centre: tuple[float, float],
    huber: float,
) -> Consensus:
    """Return which sub-areas agree with the motion that left these residuals.

    Parameters
    ----------
    texture : (8, N) float32
        Remembered pixels.
    differences : (N,) float32
        Their residuals after the motion.
    slopes : ((N,), (N,)) float32
        Along u and v, as in the refinement.
    areas : (N,) int64
        Of `areas_of`.
    centre : (float, float)
        Centre of the turn [px].
    huber : float
        As in the refinement.
    """
    sums = _equations(texture, differences, slopes, areas, centre, huber)
    agrees, n_voting, scatter = _decide(sums)
    return Consensus(agrees, n_voting, scatter)


@kernel
def _decide(sums: Floats) -> tuple[Bools, int, Floats]:
    """Return which areas agree, how many have a vote, and the scatter of the gradients of those that agree."""
    n_areas = len(sums)
    votes, agrees = np.zeros(n_areas, np.bool_), np.zeros(n_areas, np.bool_)
    shift_u, shift_v, left = np.zeros(n_areas), np.zeros(n_areas), np.zeros(n_areas)
    determinant, weakest, stray = np.empty(n_areas), np.empty(n_areas), np.empty(n_areas)
    for a in range(n_areas):
        determinant[a] = sums[a, 0] * sums[a, 2] - sums[a, 1] * sums[a, 1]
        weakest[a] = determinant[a] / max(sums[a, 0] + sums[a, 2], 1e-9)
    least = _LEAST_SHARE * median_of(weakest)
    n_voting = 0
    for a in range(n_areas):
        if sums[a, 7] < _LEAST_PIXELS or weakest[a] <= least or determinant[a] <= 0.0:
            continue
        votes[a] = True
        n_voting += 1
        u = (sums[a, 2] * sums[a, 3] - sums[a, 1] * sums[a, 4]) / determinant[a]
        v = (sums[a, 0] * sums[a, 4] - sums[a, 1] * sums[a, 3]) / determinant[a]
        left[a] = max(0.0, sums[a, 6] - sums[a, 3] * u - sums[a, 4] * v)  # what its own shift leaves unexplained
        shift_u[a] = min(max(u, -_MOST_STRAY_PX), _MOST_STRAY_PX)
        shift_v[a] = min(max(v, -_MOST_STRAY_PX), _MOST_STRAY_PX)
    scatter = np.zeros((3, 3), np.float64)
    if n_voting == 0:
        return agrees, 0, scatter
    # the common motion may have been dragged: what most areas would correct it by is where they are measured from
    middle_u, middle_v = _median_of_voting(shift_u, votes), _median_of_voting(shift_v, votes)
    for a in range(n_areas):
        stray[a] = math.hypot(shift_u[a] - middle_u, shift_v[a] - middle_v)
    limit = max(_LEAST_STRAY_PX, _STRAY_FACTOR * _median_of_voting(stray, votes))
    mean, n_agreeing = np.zeros(3), 0
    for a in range(n_areas):
        own_px = math.sqrt(left[a] / sums[a, 7] / max(weakest[a], 1e-9)) if votes[a] else 0.0
        agrees[a] = votes[a] and stray[a] <= max(limit, _OWN_SIGMAS * own_px)
        if agrees[a]:
            n_agreeing += 1
            for i in range(3):
                mean[i] += sums[a, 3 + i]
    for i in range(3):
        mean[i] /= max(n_agreeing, 1)
    for a in range(n_areas):
        if agrees[a]:
            for i in range(3):
                for j in range(3):
                    scatter[i, j] += (sums[a, 3 + i] - mean[i]) * (sums[a, 3 + j] - mean[j])
    of_few = max(n_agreeing, 4) / (max(n_agreeing, 4) - 3.0)
    for i in range(3):
        for j in range(3):
            scatter[i, j] *= of_few
    return agrees, n_voting, scatter


@inner_kernel
def _median_of_voting(values: Floats, votes: Bools) -> float:
    chosen, n = np.empty(values.shape[0]), 0
    for a in range(values.shape[0]):
        if votes[a]:
            chosen[n] = values[a]
            n += 1
    return median_of(chosen[:n])


def relit(texture: Texture, differences: Float32s, areas: Int64s, clip: float) -> Texture:
    """Return remembered pixels with the contrast and the brightness that their sub-areas have now.

    Parameters
    ----------
    texture : (8, N) float32
        Remembered pixels.
    differences : (N,) float32
        Their residuals after about the right motion.
    areas : (N,) int64
        Of `areas_of`.
    clip : float
        Largest residual that counts.
    """
    n_areas = N_SIDE * N_SIDE
    values = texture[VALUE].astype(np.float64)
    seen = values + np.clip(differences, -clip, clip)
    counts = np.maximum(np.bincount(areas, minlength=n_areas), 1)

    def mean(of: Floats) -> Floats:
        return np.asarray(np.bincount(areas, of, n_areas) / counts, np.float64)

    middle, seen_middle = mean(values), mean(seen)
    apart, seen_apart = values - middle[areas], seen - seen_middle[areas]
    # both are noisy: the ratio of the spreads is not biased towards zero, as a regression is
    gain = np.sqrt(mean(seen_apart**2) / np.maximum(mean(apart**2), 1e-9))
    gain = np.clip(np.where(counts >= _LEAST_PIXELS, gain, 1.0), *_GAINS)
    out = texture.copy()
    out[VALUE] = seen_middle[areas] + gain[areas] * apart
    out[[SLOPE_U, SLOPE_V]] *= gain[areas].astype(np.float32)
    return out
