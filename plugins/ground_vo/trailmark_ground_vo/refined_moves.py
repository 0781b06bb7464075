"""Both groups move like one rigid body, refined: as the light is, or where it is not to be trusted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from trailmark.arrays import Float32s, Grey8, Grey16
from trailmark_ground_vo.brightness import EVEN_LEVEL, fade_pixels
from trailmark_ground_vo.cleaning import contrast_of, in_even_light
from trailmark_ground_vo.closed_places import closed_by
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.filters import SMOOTH_SCALE, levels_of, noise_level
from trailmark_ground_vo.guarded_refinement import GuardedRefinement
from trailmark_ground_vo.judging import MatchPair
from trailmark_ground_vo.kernels import Kernels
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.moves import Disagreement, GroupMove, MoveStrategy, PredictedMove, TwoViews
from trailmark_ground_vo.refinement import Refinement
from trailmark_ground_vo.uncertainty import drift_information, with_scatter
from trailmark_ground_vo.viewpoint import SearchPicture
from trailmark_ground_vo.witness import ShiftVote, ShiftWitness

__all__ = ["GuardedMove", "RefinedMove"]

#: Refinement steps of the guarded tracker over those of the plain one: noise makes slopes look steep, and steps short.
_PATIENCE = 5

#: Least contrast of a smoothed picture over the noise before it; below, the picture is smoothed more.
_LEAST_CONTRAST = 0.6


class _DimFilter(NamedTuple):
    """A Gauss filter for dim pictures.

    Attributes
    ----------
    sigma_px : float
        Standard deviation of the filter [px].
    noise : float
        Share of the noise of the smoothed picture that it leaves.
    """

    sigma_px: float
    noise: float


_FINE, _COARSE = _DimFilter(1.6, 0.55), _DimFilter(3.2, 0.31)

#: The coarse filter costs detail: it is for ground that noise hides after the fine one, which leaves a mean absolute
#: difference of 0.12 of noise alone, and that stands out so many times better after the coarse one.
_HIDDEN, _MUCH_BETTER = 0.2, 1.25

#: One row and column in so many tells the contrast.
_EVERY = 4

#: Shares of the sub-areas and of the remembered pixels that a motion needs.
_LEAST_AGREEING, _LEAST_FITTING = 0.6, 0.35

#: Drift variance per replacement of all pixels over that of one alignment, measured on ten floors (see README.md).
_GROWTH = 2.5


class RefinedMove(MoveStrategy):
    """Refines the matches and moves both groups like one rigid body, in light that stays as it is.

    Parameters
    ----------
    config, views, kernels, max_shift_px
        As in `MoveStrategy`.
    size : (int, int)
        Width and height of the pictures [px].
    """

    def __init__(
        self, config: GroundVOConfig, views: TwoViews, kernels: Kernels, *, max_shift_px: int, size: tuple[int, int]
    ) -> None:
        super().__init__(config, views, kernels, max_shift_px=max_shift_px)
        self._refinement = Refinement(config, size, views.aspect)
        self._middle_v = (size[1] - 1) / 2.0
        self._is_smooth = bool(config.smooth_search)

    def prepare(self, image: Grey8) -> SearchPicture:
        """Return the picture smoothed, and what is searched: the same once the light is even, else as it is."""
        smoothed, noise = self._kernels.smooth(image), None
        if self._is_smooth:
            image, noise = levels_of(smoothed), noise_level(image)
        return SearchPicture(image, self._kernels.transpose(image), smoothed=smoothed, noise=noise)

    def begin(self, picture: SearchPicture) -> None:
        """Choose the pixels of the groups and of the refinement."""
        super().begin(picture)
        assert picture.smoothed is not None
        self._refinement.begin(picture.smoothed)

    def move(
        self, picture: SearchPicture, matches: MatchPair, guesses: Sequence[ImageMotion] = ()
    ) -> GroupMove | Disagreement:
        """Refine Eq. (3) and move both groups by what came out."""
        assert picture.smoothed is not None
        aligned = self._refinement.align(picture.smoothed, [*self._starts(matches), *guesses])
        lower, upper = self._of_groups(aligned.motion)
        replaced = self._refinement.follow(picture.smoothed, aligned)
        self._views.advance(picture, lower, upper, 0.0)
        return GroupMove(
            aligned.motion,
            lower,
            upper,
            drift_information(aligned.information, replaced, _GROWTH),
            replaced,
            residual=aligned.residual,
            iterations=aligned.iterations,
        )

    def new_flat_field(self) -> Float32s | None:
        """Return the flat field that the refinement has learned, when there is a new one."""
        return self._refinement.new_flat_field()

    def on_flat_field(self) -> None:
        """Search on the smoothed picture from now on, unless the config forbids it."""
        self._is_smooth = self._config.smooth_search is not False

    def _starts(self, matches: MatchPair) -> list[ImageMotion]:
        found = self._views.combine(matches)
        mean_turn = (matches[0].motion.turn_rad + matches[1].motion.turn_rad) / 2
        return [found, ImageMotion(found.u, found.v, mean_turn), ImageMotion(found.u, found.v, 0.0)]

    def _of_groups(self, motion: ImageMotion) -> tuple[ImageMotion, ImageMotion]:
        lower, upper = (
            motion.about(0.0, viewpoint.centre[1] - self._middle_v, self._views.aspect)
            for viewpoint in (self._views.lower, self._views.upper)
        )
        return lower, upper


class GuardedMove(RefinedMove):
    """The same in any light: pictures are cleaned, phase correlation has a vote, and sub-areas have to agree.

    Parameters
    ----------
    config, views, kernels, max_shift_px, size
        As in `RefinedMove`.
    """

    def __init__(
        self, config: GroundVOConfig, views: TwoViews, kernels: Kernels, *, max_shift_px: int, size: tuple[int, int]
    ) -> None:
        super().__init__(config, views, kernels, max_shift_px=max_shift_px, size=size)
        patient = config.model_copy(update={"max_iterations": _PATIENCE * config.max_iterations})
        self._agreement = GuardedRefinement(patient, size, views.aspect)
        self._witness = ShiftWitness(size)
        self._most_turn_rad = math.radians(config.rotation_steps * config.rotation_step_deg)
        self._weights: Grey8 | None = None
        self._is_decided = False
        self._dim: _DimFilter | None = None

    def prepare(self, image: Grey8) -> SearchPicture:
        """Return the picture cleaned and smoothed, with what phase correlation compares."""
        cleaned, even = in_even_light(image)
        noise = float(noise_level(cleaned))
        has_more = even is not cleaned or self._weights is not None
        if self._weights is not None:
            cleaned = fade_pixels(cleaned, self._weights)
        smoothed, searched = self._kernels.smooth(cleaned), cleaned
        if not self._is_decided:
            self._dim, self._is_decided = _dim_filter(smoothed, noise), True
        unmasked = self._kernels.smooth(even) if has_more else None
        if self._dim is not None:
            smoothed = _blurred(smoothed, self._dim)
            unmasked = None if unmasked is None else _blurred(unmasked, self._dim)
            noise *= self._dim.noise
        if self._config.smooth_search is not False:
            searched = levels_of(smoothed)
        return SearchPicture(
            searched,
            self._kernels.transpose(searched),
            smoothed=smoothed,
            noise=noise if searched is not cleaned else None,
            spectrum=self._witness.spectrum(cleaned),
            unmasked=searched if unmasked is None else levels_of(unmasked),
        )

    def on_resume(self, image: Grey8) -> SearchPicture:
        """Decide by the noise of this picture how much the next ones are smoothed."""
        self._is_decided = False
        return self.prepare(image)

    def ignore(self, weights: Grey8) -> None:
        """Fade out what is fixed to the lens, and give it no say."""
        self._weights = weights
        self._agreement.ignore(closed_by(weights))

    def begin(self, picture: SearchPicture) -> None:
        """Choose the pixels of the groups and of the refinement."""
        self._views.begin(picture, self._config.n_pixels)
        assert picture.smoothed is not None
        self._agreement.begin(picture.smoothed)

    def predict(self, last: ImageMotion, pace: float) -> PredictedMove:
        """Return where a group is searched for; turns are predicted where the search would not reach them."""
        # within half of its range the search needs no predicted turn, and has none, as in the paper
        turn_rad = pace * last.turn_rad
        is_far = abs(turn_rad) > self._most_turn_rad / 2
        return PredictedMove(super().predict(last, pace).shift, turn_rad if is_far else 0.0)

    def move(
        self, picture: SearchPicture, matches: MatchPair, guesses: Sequence[ImageMotion] = ()
    ) -> GroupMove | Disagreement:
        """Refine Eq. (3) and move both groups by what came out, if enough of the picture agrees."""
        assert picture.smoothed is not None
        aligned = self._agreement.align(picture.smoothed, [*self._starts(matches), *guesses])
        if aligned.agreeing < _LEAST_AGREEING or aligned.fitting < _LEAST_FITTING:
            return Disagreement(aligned.agreeing, aligned.fitting)
        lower, upper = self._of_groups(aligned.motion)
        replaced = self._agreement.follow(picture.smoothed, aligned)
        self._views.advance(picture, lower, upper, 0.0)
        drift = drift_information(aligned.information, replaced, _GROWTH)
        return GroupMove(
            aligned.motion,
            lower,
            upper,
            with_scatter(drift, aligned.scatter),
            replaced,
            residual=aligned.residual,
            iterations=aligned.iterations,
            fitting=aligned.fitting,
            agreeing=aligned.agreeing,
        )

    def vote(self, before: SearchPicture, now: SearchPicture) -> ShiftVote | None:
        """Return what phase correlation says."""
        if before.spectrum is None or now.spectrum is None:
            return None
        return self._witness.compare(before.spectrum, now.spectrum)


def _dim_filter(smoothed: Grey16, noise: float) -> _DimFilter | None:
    """Return what a picture is filtered with so that its noise does not hide it; None where it need not be."""
    if contrast_of(levels_of(smoothed)) >= _LEAST_CONTRAST * noise:
        return None
    fine, coarse = (_contrast(_blurred(smoothed, dim)) for dim in (_FINE, _COARSE))
    is_hidden = fine < _HIDDEN * noise
    return _COARSE if is_hidden and coarse / _COARSE.noise > _MUCH_BETTER * fine / _FINE.noise else _FINE


def _contrast(smoothed: Grey16) -> float:
    """Return the mean absolute difference from even light [grey levels]."""
    sparse = smoothed[::_EVERY, ::_EVERY].astype(np.int32) - SMOOTH_SCALE * EVEN_LEVEL
    return float(np.mean(np.abs(sparse))) / SMOOTH_SCALE


def _blurred(smoothed: Grey16, dim: _DimFilter) -> Grey16:
    return np.asarray(cv2.GaussianBlur(smoothed, (0, 0), dim.sigma_px), np.uint16)
