"""The refinement where a share of the picture may show something else than the ground, or in another light."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Bools, Float32s, Floats, Grey16, Int64s
from trailmark_ground_vo.consensus import Consensus, areas_of, consensus_of, relit
from trailmark_ground_vo.filters import SMOOTH_SCALE
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.refine import mean_clipped, mean_slopes
from trailmark_ground_vo.refinement import CLIP, Aligned, Refinement
from trailmark_ground_vo.texture import SLOPE_U, SLOPE_V, Texture, residuals

__all__ = ["AgreedAlignment", "GuardedRefinement"]

#: A pixel whose residual is more standard deviations than this, and more than so many levels, is not what it was.
_MISFIT_SIGMAS, _LEAST_MISFIT = 6.0, 12.0 * SMOOTH_SCALE

#: Share of fitting pixels from which on the few others do no harm.
_CALM_SHARE = 0.85

#: How often sub-areas are left out.
_ROUNDS = 3

#: Least reliable share of the slopes: below, nothing is known [1].
_LEAST_RELIABILITY = 0.02

#: Share of its own curvature that a direction has whatever the others say.
_RIDGE = 1e-6

#: Residual that no pixel of the ground has.
_NOT_GROUND = 255.0 * SMOOTH_SCALE

#: Standard deviation over median absolute deviation, and over mean absolute deviation, of a normal distribution.
_SIGMA_OVER_MEDIAN, _SIGMA_OVER_MEAN = 1.4826, math.sqrt(math.pi / 2.0)

#: A motion is between two pictures, the place of each of which scatters.
_OWN_AND_BEFORE = 2.0

#: One pixel in so many is enough for a median.
_EVERY = 4


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AgreedAlignment(Aligned):
    """A refined motion on which sub-areas have voted.

    Attributes
    ----------
    scatter : (3, 3) float64
        Covariance of (u, v, turn), from how the sub-areas scatter.
    fitting : float
        Share of the remembered pixels that look as remembered.
    agreeing : float
        Share of the sub-areas that have this motion.
    """

    scatter: Floats
    fitting: float
    agreeing: float


class GuardedRefinement(Refinement):
    """Aligns as `Refinement` does, and lets sub-areas vote on what came out."""

    def align(self, picture: Grey16, starts: Sequence[ImageMotion]) -> AgreedAlignment:
        """Return the motion that most sub-areas have."""
        motion, after, curvature, iterations = self._minimum(picture, starts)
        texture, areas = self._texture, areas_of(self._texture, self._area)
        consensus, keeps, misfit = self._consensus(picture, texture, motion, after, areas)
        for _ in range(_ROUNDS):
            if consensus.share == 1.0 and float(np.count_nonzero(keeps)) >= _CALM_SHARE * len(keeps):
                break  # all say the same
            # the others do not look at the ground, or in another light: these are judged anew, those have no say
            texture = relit(self._texture, after, areas, CLIP)
            after = residuals(picture, texture, self._centre, motion, self._aspect)
            consensus, keeps, misfit = self._consensus(picture, texture, motion, after, areas)
            kept = np.ascontiguousarray(texture[:, keeps])
            motion, curvature, iterations = self._refine_inside(picture, kept, motion)
            after = residuals(picture, texture, self._centre, motion, self._aspect)
            consensus, keeps, misfit = self._consensus(picture, texture, motion, after, areas)
        residual = mean_clipped(after, CLIP)
        sigma = _SIGMA_OVER_MEAN * max(1.0, residual)
        return AgreedAlignment(
            ImageMotion(*motion),
            curvature / (sigma * sigma),
            residual / SMOOTH_SCALE,
            iterations,
            # where another motion is seen, what was remembered is not the ground: it will be remembered anew
            np.where(keeps, after, np.float32(_NOT_GROUND)),
            misfit,
            scatter=_sandwich(curvature, consensus.scatter, self._reliability(picture, motion)),
            fitting=float(np.count_nonzero(keeps)) / len(keeps),
            agreeing=consensus.share,
        )

    def _consensus(
        self,
        picture: Grey16,
        texture: Texture,
        motion: tuple[float, float, float],
        after: Float32s,
        areas: Int64s,
    ) -> tuple[Consensus, Bools, float]:
        """Return what the sub-areas say, which pixels look at the ground, and the residual that tells."""
        misfit = _misfit(after)
        slopes = mean_slopes(picture, texture, self._centre, motion, self._aspect)
        consensus = consensus_of(texture, after, slopes, areas=areas, centre=self._centre, huber=self._huber)
        return consensus, consensus.agrees[areas] & (np.abs(after) <= misfit), misfit

    def _reliability(self, picture: Grey16, motion: tuple[float, float, float]) -> tuple[float, float]:
        """Return which share of the squared slopes along u and v is seen in both pictures: the rest is noise."""
        means = mean_slopes(picture, self._texture, self._centre, motion, self._aspect)
        shares = []
        for mean, remembered in zip(means, (self._texture[SLOPE_U], self._texture[SLOPE_V])):
            total = float(mean @ mean)
            shared = float(remembered @ (2.0 * mean - remembered))
            shares.append(min(1.0, max(_LEAST_RELIABILITY, shared / total if total > 0.0 else 1.0)))
        return shares[0], shares[1]


def _misfit(differences: Float32s) -> float:
    """Return the residual beyond which a pixel does not show what it is remembered for, in units of the picture."""
    sizes = np.abs(differences[::_EVERY])
    middle = len(sizes) // 2
    return max(_LEAST_MISFIT, _MISFIT_SIGMAS * _SIGMA_OVER_MEDIAN * float(np.partition(sizes, middle)[middle]))


def _sandwich(curvature: Floats, scatter: Floats, reliability: tuple[float, float]) -> Floats:
    """Return the covariance of a minimum from curvature and scatter of the gradient (Huber's sandwich).

    Noise makes slopes, and so the curvature, look larger than they are: only the reliable share of it holds the motion.
    """
    # a direction without texture has no curvature: there the covariance is large, not infinite
    inverse = np.linalg.inv(curvature + np.diag(_RIDGE * np.diag(curvature) + 1.0))
    scale = 1.0 / np.array([reliability[0], reliability[1], min(reliability)])
    return np.asarray(_OWN_AND_BEFORE * inverse @ scatter @ inverse * np.outer(scale, scale), np.float64)
