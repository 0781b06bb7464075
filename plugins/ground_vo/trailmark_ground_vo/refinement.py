"""The refinement with its memory: remembered pixels that roll along with the ground."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trailmark.arrays import Bools, Float32s, Floats, Grey16, Int64s
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.consensus import Consensus, areas_of, consensus_of, relit
from trailmark_ground_vo.extremes import Area
from trailmark_ground_vo.filters import SMOOTH_SCALE
from trailmark_ground_vo.flat_field import FlatFieldLearner
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.refine import best_start, mean_clipped, mean_slopes, refine
from trailmark_ground_vo.texture import SLOPE_U, SLOPE_V, Texture, X, Y, advance_texture, residuals, select_texture

__all__ = ["Aligned", "Refinement"]

#: Residuals are clipped here when costs are compared: a pixel that is covered says no more than that.
_CLIP = 30.0 * SMOOTH_SCALE

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

#: What a pixel needs around it [px].
_RIM_PX = 12.0

#: Standard deviation over median absolute deviation of a normal distribution.
_SIGMA_OVER_MEDIAN = 1.4826

#: Starts are compared on every fourth pixel.
_EVERY = 4

#: Standard deviation over mean absolute deviation of a normal distribution.
_SIGMA_OVER_MEAN = math.sqrt(math.pi / 2.0)


@dataclass(frozen=True, slots=True, eq=False)
class Aligned:
    """The refined motion of the content.

    Attributes
    ----------
    motion : ImageMotion
        About the middle of the picture.
    information : (3, 3) float64
        Of (u, v, turn) against the remembered pixels.
    scatter : (3, 3) float64
        Covariance of (u, v, turn), from how the sub-areas scatter.
    residual : float
        Mean absolute residual [grey levels].
    iterations : int
        Steps taken.
    fitting : float
        Share of the remembered pixels that look as remembered.
    agreeing : float
        Share of the sub-areas that have this motion.
    differences : (N,) float32
        Residual of each remembered pixel, in units of the smoothed picture; beyond `misfit` it is no ground.
    misfit : float
        See there.
    """

    motion: ImageMotion
    information: Floats
    scatter: Floats
    residual: float
    iterations: int
    fitting: float
    agreeing: float
    differences: Float32s
    misfit: float


class _Refined(NamedTuple):
    """What `refine` gives."""

    motion: tuple[float, float, float]
    curvature: Floats
    iterations: int


class Refinement:
    """Aligns each picture with remembered pixels (see `texture` and `refine`)."""

    def __init__(self, config: GroundVOConfig, size: tuple[int, int], aspect: float) -> None:
        margin = config.margin_px
        self._config = config
        self._area: Area = (margin, margin, size[0] - margin, size[1] - margin)
        self._centre = ((size[0] - 1) / 2.0, (size[1] - 1) / 2.0)
        self._aspect = aspect
        self._learner = FlatFieldLearner(size, aspect) if config.learn_flat_field else None
        self._near_px = margin - _RIM_PX
        self._texture: Texture

    def begin(self, picture: Grey16) -> None:
        """Choose the pixels in a picture, smoothed (see `filters.smooth`)."""
        self._texture = select_texture(picture, self._area, self._config.n_segments, self._config.line_step_px)

    def align(self, picture: Grey16, starts: Sequence[ImageMotion]) -> Aligned:
        """Return the refined motion, at least as good as the best start."""
        texture = self._texture
        candidates = np.array([start.array() for start in starts])
        few = np.ascontiguousarray(texture[:, ::_EVERY])
        start = starts[best_start(picture, few, self._centre, candidates, self._aspect, _CLIP)]
        motion = (start.u, start.v, start.turn_rad)
        refined = self._refined(picture, texture, motion)
        before = residuals(picture, texture, self._centre, motion, self._aspect)
        after = residuals(picture, texture, self._centre, refined.motion, self._aspect)
        if mean_clipped(after, _CLIP) <= mean_clipped(before, _CLIP):
            motion = refined.motion
        else:
            after = before
        areas = areas_of(texture, self._area)
        consensus, keeps, misfit = self._consensus(picture, texture, motion, after, areas)
        for _ in range(_ROUNDS):
            if consensus.share == 1.0 and float(np.count_nonzero(keeps)) >= _CALM_SHARE * len(keeps):
                break  # all say the same
            # the others do not look at the ground, or in another light: these are judged anew, those have no say
            texture = relit(self._texture, after, areas, _CLIP)
            after = residuals(picture, texture, self._centre, motion, self._aspect)
            consensus, keeps, misfit = self._consensus(picture, texture, motion, after, areas)
            refined = self._refined(picture, np.ascontiguousarray(texture[:, keeps]), motion)
            motion = refined.motion
            after = residuals(picture, texture, self._centre, motion, self._aspect)
            consensus, keeps, misfit = self._consensus(picture, texture, motion, after, areas)
        residual = mean_clipped(after, _CLIP)
        sigma = _SIGMA_OVER_MEAN * max(1.0, residual)
        return Aligned(
            ImageMotion(*motion),
            refined.curvature / (sigma * sigma),
            _sandwich(refined.curvature, consensus.scatter, self._reliability(picture, motion)),
            residual=residual / SMOOTH_SCALE,
            iterations=refined.iterations,
            fitting=float(np.count_nonzero(keeps)) / len(keeps),
            agreeing=consensus.share,
            # where another motion is seen, what was remembered is not the ground: it will be remembered anew
            differences=np.where(keeps, after, np.float32(_NOT_GROUND)),
            misfit=misfit,
        )

    def follow(self, picture: Grey16, aligned: Aligned) -> float:
        """Move along with an alignment of this picture; returns the share of the pixels that were replaced."""
        motion = (aligned.motion.u, aligned.motion.v, aligned.motion.turn_rad)
        if self._learner is not None:
            self._learner.add(self._texture, aligned.differences, motion)
        return self._advance(picture, aligned.differences, motion, aligned.misfit)

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
        huber = self._config.huber_levels * SMOOTH_SCALE
        consensus = consensus_of(texture, after, slopes, areas=areas, centre=self._centre, huber=huber)
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

    def _refined(self, picture: Grey16, texture: Texture, start: tuple[float, float, float]) -> _Refined:
        inside = self._in_picture(texture, start, (picture.shape[1], picture.shape[0]))
        huber = self._config.huber_levels * SMOOTH_SCALE
        return _Refined(*refine(picture, inside, self._centre, start, self._aspect, huber, self._config.max_iterations))

    def _in_picture(self, texture: Texture, motion: tuple[float, float, float], size: tuple[int, int]) -> Texture:
        """Return the pixels that a long shift leaves in the picture; all of them after a usual one."""
        if max(abs(motion[0]), abs(motion[1])) <= self._near_px:
            return texture
        u, v, rim_px = texture[X] + motion[0], texture[Y] + motion[1], _RIM_PX
        inside = (u >= rim_px) & (u < size[0] - rim_px) & (v >= rim_px) & (v < size[1] - rim_px)
        return np.ascontiguousarray(texture[:, inside])

    def new_flat_field(self) -> Float32s | None:
        """Return the flat field that was learned, (H, W) relative to its mean, when there is a new one."""
        return None if self._learner is None else self._learner.news()

    def _advance(
        self,
        picture: Grey16,
        differences: Float32s,
        motion: tuple[float, float, float],
        misfit: float,
    ) -> float:
        config = self._config
        self._texture, n_fresh = advance_texture(
            picture,
            self._texture,
            differences,
            self._area,
            config.n_segments,
            self._centre,
            motion,
            self._aspect,
            float(config.memory_frames),
            config.huber_levels * SMOOTH_SCALE,
            misfit,
        )
        return n_fresh / len(differences)


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
    return np.asarray(inverse @ scatter @ inverse * np.outer(scale, scale), np.float64)
