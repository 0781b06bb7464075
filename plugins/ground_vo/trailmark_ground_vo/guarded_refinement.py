"""The refinement where a share of the picture may show something else than the ground, or in another light."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Bools, Float32s, Floats, Grey16, Int64s
from trailmark_ground_vo.closed_places import is_at
from trailmark_ground_vo.consensus import Consensus, areas_of, consensus_of, relit
from trailmark_ground_vo.filters import SMOOTH_SCALE
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.refine import mean_clipped, mean_slopes
from trailmark_ground_vo.refinement import CLIP, Aligned, Refinement
from trailmark_ground_vo.texture import AGE, SLOPE_U, SLOPE_V, Texture, learn_anew, residuals

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

#: Fewer remembered pixels than this do not hold a motion, of one or two thousand.
_LEAST_OPEN = 300

_NO_MOTION = (0.0, 0.0, 0.0)


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

    _closed: Bools | None = None
    _is_unseen: Bools

    def begin(self, picture: Grey16) -> None:
        """Choose the pixels in a picture, smoothed (see `filters.smooth`)."""
        super().begin(picture)
        self._is_unseen = self._is_closed(_NO_MOTION)

    def ignore(self, closed: Bools | None) -> None:
        """Give no pixel a say where something is fixed to the lens, (H, W) bool; None: give all a say.

        What is faded there ends at the rim of the mark, and the rim stands still: along a grain, where the ground
        itself holds nothing, such ends would hold the motion.
        """
        self._closed = closed
        self._is_unseen = self._is_closed(_NO_MOTION)

    def follow(self, picture: Grey16, aligned: Aligned) -> float:
        """Move along with an alignment of this picture; returns the share of the pixels that were replaced."""
        replaced = super().follow(picture, aligned)
        if self._closed is not None:
            is_closed = self._is_closed(_NO_MOTION)
            learn_anew(picture, self._texture, self._is_unseen & ~is_closed)
            is_fresh = self._texture[AGE] == 1.0
            self._is_unseen = is_closed & (self._is_unseen | is_fresh)
        return replaced

    def _is_closed(self, motion: tuple[float, float, float]) -> Bools:
        """Return which remembered pixels a motion brings to where no pixel has a say."""
        if self._closed is None:
            return np.zeros(self._texture.shape[1], np.bool_)
        return is_at(self._closed, self._texture, self._centre, motion, self._aspect)

    def _best_open(self, picture: Grey16, starts: Sequence[ImageMotion]) -> tuple[Sequence[ImageMotion], Bools]:
        """Return the start that fits best where pixels have a say, and which of them have after it.

        Where too few have, all starts, and all pixels.
        """
        best, least, is_open = starts, math.inf, np.ones(self._texture.shape[1], np.bool_)
        for start in starts:
            motion = (start.u, start.v, start.turn_rad)
            seen = ~(self._is_unseen | self._is_closed(motion))
            if np.count_nonzero(seen) < _LEAST_OPEN:
                continue
            texture = np.ascontiguousarray(self._texture[:, seen][:, ::_EVERY])
            cost = mean_clipped(residuals(picture, texture, self._centre, motion, self._aspect), CLIP)
            if cost < least:
                best, least, is_open = [start], cost, seen
        return best, is_open

    def align(self, picture: Grey16, starts: Sequence[ImageMotion]) -> AgreedAlignment:
        """Return the motion that most sub-areas have."""
        remembered, is_open = self._texture, np.ones(self._texture.shape[1], np.bool_)
        if self._closed is not None:
            starts, is_open = self._best_open(picture, starts)
            remembered = np.ascontiguousarray(self._texture[:, is_open])
        motion, after, curvature, iterations = self._minimum(picture, remembered, starts)
        texture, areas = remembered, areas_of(remembered, self._area)
        consensus, keeps, misfit = self._consensus(picture, texture, motion, after, areas)
        for _ in range(_ROUNDS):
            if consensus.share == 1.0 and float(np.count_nonzero(keeps)) >= _CALM_SHARE * len(keeps):
                break  # all say the same
            # the others do not look at the ground, or in another light: these are judged anew, those have no say
            texture = relit(remembered, after, areas, CLIP)
            after = residuals(picture, texture, self._centre, motion, self._aspect)
            consensus, keeps, misfit = self._consensus(picture, texture, motion, after, areas)
            kept = np.ascontiguousarray(texture[:, keeps])
            motion, curvature, iterations = self._refine_inside(picture, kept, motion)
            after = residuals(picture, texture, self._centre, motion, self._aspect)
            consensus, keeps, misfit = self._consensus(picture, texture, motion, after, areas)
        residual = mean_clipped(after, CLIP)
        sigma = _SIGMA_OVER_MEAN * max(1.0, residual)
        # where another motion is seen, what was remembered is not the ground: it has no say until the pixel jumps
        differences = np.zeros(len(is_open), np.float32)
        differences[is_open] = np.where(keeps, after, np.float32(_NOT_GROUND))
        return AgreedAlignment(
            ImageMotion(*motion),
            curvature / (sigma * sigma),
            residual / SMOOTH_SCALE,
            iterations,
            differences,
            misfit,
            scatter=_sandwich(curvature, consensus.scatter, self._reliability(picture, remembered, motion)),
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
        """Return the consensus of the sub-areas, which pixels look at the ground, and the residual that decides."""
        misfit = _misfit(after)
        slopes = mean_slopes(picture, texture, self._centre, motion, self._aspect)
        consensus = consensus_of(texture, after, slopes, areas=areas, centre=self._centre, huber=self._huber)
        return consensus, consensus.agrees[areas] & (np.abs(after) <= misfit), misfit

    def _reliability(
        self, picture: Grey16, texture: Texture, motion: tuple[float, float, float]
    ) -> tuple[float, float]:
        """Return which share of the squared slopes along u and v is seen in both pictures: the rest is noise."""
        means = mean_slopes(picture, texture, self._centre, motion, self._aspect)
        shares = []
        for mean, remembered in zip(means, (texture[SLOPE_U], texture[SLOPE_V])):
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
