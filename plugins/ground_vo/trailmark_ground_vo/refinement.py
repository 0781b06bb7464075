"""The refinement with its memory: remembered pixels that roll along with the ground."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Float32s, Floats, Grey16
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.extremes import Area
from trailmark_ground_vo.filters import SMOOTH_SCALE
from trailmark_ground_vo.flat_field import FlatFieldLearner
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.refine import best_start, mean_clipped, refine
from trailmark_ground_vo.texture import Texture, advance_texture, residuals, select_texture

__all__ = ["Aligned", "Refinement"]

#: Residuals are clipped here when costs are compared: a pixel that is covered says no more than that.
_CLIP = 30.0 * SMOOTH_SCALE

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
    residual : float
        Mean absolute residual [grey levels].
    iterations : int
        Steps taken.
    replaced : float
        Share of the remembered pixels that were replaced.
    """

    motion: ImageMotion
    information: Floats
    residual: float
    iterations: int
    replaced: float


class Refinement:
    """Aligns each picture with remembered pixels (see `texture` and `refine`)."""

    def __init__(self, config: GroundVOConfig, size: tuple[int, int], aspect: float) -> None:
        margin = config.margin_px
        self._config = config
        self._area: Area = (margin, margin, size[0] - margin, size[1] - margin)
        self._centre = ((size[0] - 1) / 2.0, (size[1] - 1) / 2.0)
        self._aspect = aspect
        self._learner = FlatFieldLearner(size, aspect) if config.learn_flat_field else None
        self._texture: Texture

    def begin(self, picture: Grey16) -> None:
        """Choose the pixels in a picture, smoothed (see `filters.smooth`)."""
        self._texture = select_texture(picture, self._area, self._config.n_segments, self._config.line_step_px)

    def align(self, picture: Grey16, starts: Sequence[ImageMotion]) -> Aligned:
        """Return the refined motion, at least as good as the best start, and move along with it."""
        texture = self._texture
        candidates = np.array([start.array() for start in starts])
        few = np.ascontiguousarray(texture[:, ::_EVERY])
        start = starts[best_start(picture, few, self._centre, candidates, self._aspect, _CLIP)]
        motion = (start.u, start.v, start.turn_rad)
        huber = self._config.huber_levels * SMOOTH_SCALE
        refined, curvature, iterations = refine(
            picture, texture, self._centre, motion, self._aspect, huber, self._config.max_iterations
        )
        before = residuals(picture, texture, self._centre, motion, self._aspect)
        after = residuals(picture, texture, self._centre, refined, self._aspect)
        if mean_clipped(after, _CLIP) <= mean_clipped(before, _CLIP):
            motion = refined
        else:
            after = before
        if self._learner is not None:
            self._learner.add(texture, after, motion)
        replaced = self._advance(picture, after, motion)
        residual = mean_clipped(after, _CLIP)
        sigma = _SIGMA_OVER_MEAN * max(1.0, residual)
        information = curvature / (sigma * sigma)
        return Aligned(ImageMotion(*motion), information, residual / SMOOTH_SCALE, iterations, replaced)

    def new_flat_field(self) -> Float32s | None:
        """Return the flat field that was learned, (H, W) relative to its mean, when there is a new one."""
        return None if self._learner is None else self._learner.news()

    def _advance(
        self,
        picture: Grey16,
        differences: Float32s,
        motion: tuple[float, float, float],
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
        )
        return n_fresh / len(differences)
