"""The refinement with its memory: remembered pixels that roll along with the ground."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trailmark.arrays import Float32s, Floats, Grey16
from trailmark_ground_vo.areas import margin_px
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.extremes import Area
from trailmark_ground_vo.filters import SMOOTH_SCALE
from trailmark_ground_vo.flat_field import FlatFieldLearner
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.refine import best_start, mean_clipped, refine
from trailmark_ground_vo.texture import Texture, X, Y, advance_texture, residuals, select_texture

__all__ = ["CLIP", "Aligned", "Minimum", "Refinement"]

#: Residuals are clipped here when costs are compared: a pixel that is covered says no more than that.
CLIP = 30.0 * SMOOTH_SCALE

#: Starts are compared on every fourth pixel.
_EVERY = 4

#: What a pixel needs around it [px].
_RIM_PX = 12.0

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
    residual : float
        Mean absolute residual [grey levels].
    iterations : int
        Steps taken.
    differences : (N,) float32
        Residual of each remembered pixel, in units of the smoothed picture.
    misfit : float
        A pixel with a larger difference is not what was remembered; infinite where that is not asked.
    """

    motion: ImageMotion
    information: Floats
    residual: float
    iterations: int
    differences: Float32s
    misfit: float = math.inf


class Minimum(NamedTuple):
    """Where the refinement ends.

    Attributes
    ----------
    motion : (float, float, float)
        (u, v, turn).
    differences : (N,) float32
        Residuals there.
    curvature : (3, 3) float64
        Of half the sum of their squares.
    iterations : int
        Steps taken.
    """

    motion: tuple[float, float, float]
    differences: Float32s
    curvature: Floats
    iterations: int


class Refinement:
    """Aligns each picture with remembered pixels (see `texture` and `refine`).

    Parameters
    ----------
    config : GroundVOConfig
        Parameters of the refinement.
    size : (int, int)
        Width and height of the pictures [px].
    aspect : float
        Metres per pixel along v over those along u.
    """

    def __init__(self, config: GroundVOConfig, size: tuple[int, int], aspect: float) -> None:
        margin = margin_px(config, size)
        self._config = config
        self._area: Area = (margin, margin, size[0] - margin, size[1] - margin)
        self._centre = ((size[0] - 1) / 2.0, (size[1] - 1) / 2.0)
        self._aspect = aspect
        self._huber = config.huber_levels * SMOOTH_SCALE
        self._learner = FlatFieldLearner(size, aspect) if config.learn_flat_field else None
        self._near_px = margin - _RIM_PX
        self._texture: Texture

    def begin(self, picture: Grey16) -> None:
        """Choose the pixels in a picture, smoothed (see `filters.smooth`)."""
        self._texture = select_texture(picture, self._area, self._config.n_segments, self._config.line_step_px)

    def align(self, picture: Grey16, starts: Sequence[ImageMotion]) -> Aligned:
        """Return the refined motion, at least as good as the best start."""
        found = self._minimum(picture, self._texture, starts)
        residual = mean_clipped(found.differences, CLIP)
        sigma = _SIGMA_OVER_MEAN * max(1.0, residual)
        information = found.curvature / (sigma * sigma)
        motion = ImageMotion(*found.motion)
        return Aligned(motion, information, residual / SMOOTH_SCALE, found.iterations, found.differences)

    def follow(self, picture: Grey16, aligned: Aligned) -> float:
        """Move along with an alignment of this picture; returns the share of the pixels that were replaced."""
        motion = (aligned.motion.u, aligned.motion.v, aligned.motion.turn_rad)
        if self._learner is not None:
            self._learner.add(self._texture, aligned.differences, motion)
        self._texture, n_fresh = advance_texture(
            picture,
            self._texture,
            aligned.differences,
            self._area,
            self._config.n_segments,
            self._centre,
            motion,
            self._aspect,
            float(self._config.memory_frames),
            self._huber,
            aligned.misfit,
        )
        return n_fresh / len(aligned.differences)

    def new_flat_field(self) -> Float32s | None:
        """Return the flat field that was learned, (H, W) relative to its mean, when there is a new one."""
        return None if self._learner is None else self._learner.news()

    def _minimum(self, picture: Grey16, texture: Texture, starts: Sequence[ImageMotion]) -> Minimum:
        """Return the minimum that the best start leads to, or that start where it is better."""
        candidates = np.array([start.array() for start in starts])
        few = np.ascontiguousarray(texture[:, ::_EVERY])
        start = starts[best_start(picture, few, self._centre, candidates, self._aspect, CLIP)]
        motion = (start.u, start.v, start.turn_rad)
        refined, curvature, iterations = self._refine_inside(picture, texture, motion)
        before = residuals(picture, texture, self._centre, motion, self._aspect)
        after = residuals(picture, texture, self._centre, refined, self._aspect)
        if mean_clipped(after, CLIP) <= mean_clipped(before, CLIP):
            return Minimum(refined, after, curvature, iterations)
        return Minimum(motion, before, curvature, iterations)

    def _refine_inside(
        self, picture: Grey16, texture: Texture, start: tuple[float, float, float]
    ) -> tuple[tuple[float, float, float], Floats, int]:
        inside = self._in_picture(texture, start, (picture.shape[1], picture.shape[0]))
        return refine(picture, inside, self._centre, start, self._aspect, self._huber, self._config.max_iterations)

    def _in_picture(self, texture: Texture, motion: tuple[float, float, float], size: tuple[int, int]) -> Texture:
        """Return the pixels that a long shift leaves in the picture; all of them after a usual one."""
        if max(abs(motion[0]), abs(motion[1])) <= self._near_px:
            return texture
        u, v, rim_px = texture[X] + motion[0], texture[Y] + motion[1], _RIM_PX
        inside = (u >= rim_px) & (u < size[0] - rim_px) & (v >= rim_px) & (v < size[1] - rim_px)
        return np.ascontiguousarray(texture[:, inside])
