"""What is done with matches: each group moves by its own, or both like one rigid body, refined.

A strategy prepares the picture in the forms that its search reads, searches for a group, and moves what is remembered.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from trailmark.arrays import Float32s, Floats, Grey8
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.judging import MatchPair
from trailmark_ground_vo.kernels import Kernels
from trailmark_ground_vo.levels import half_picture
from trailmark_ground_vo.motion import ImageMotion, combine
from trailmark_ground_vo.uncertainty import drift_information, whole_pixel_information
from trailmark_ground_vo.viewpoint import GroupMatch, SearchPicture, Viewpoint
from trailmark_ground_vo.witness import ShiftVote

__all__ = [
    "Disagreement",
    "GroupMove",
    "MoveStrategy",
    "PredictedMove",
    "PyramidMove",
    "TwoViews",
    "WholePixelMove",
]

#: Bits after the point of the paper's coordinates: 9.7 fixed point.
_PAPER_GRID = 128.0

#: Shares of the sub-areas and of the remembered pixels that a motion needs.
_LEAST_AGREEING, _LEAST_FITTING = 0.6, 0.35

#: Drift variance per replacement of all pixels over that of one alignment, measured on ten floors (see README.md).
_GROWTH_WHOLE_PIXELS, _GROWTH_REFINED = 0.15, 2.5


@dataclass(frozen=True, slots=True, eq=False)
class GroupMove:
    """How the content of a picture moved, and what was remembered with it.

    Attributes
    ----------
    motion : ImageMotion
        Of the content, about the middle of the picture.
    lower, upper : ImageMotion
        Of each group, about the centre of its area.
    information : (3, 3) float64
        Of (u, v, turn) of `motion` [1/px^2, 1/px^2, 1/rad^2 on the diagonal].
    replaced : float
        Share of the pixels that were replaced.
    residual : float or None
        Mean absolute residual of the refinement [grey levels].
    iterations : int or None
        Steps of the refinement.
    fitting : float or None
        Share of the remembered pixels that look as remembered.
    agreeing : float or None
        Share of the sub-areas that have this motion.
    """

    motion: ImageMotion
    lower: ImageMotion
    upper: ImageMotion
    information: Floats
    replaced: float
    residual: float | None = None
    iterations: int | None = None
    fitting: float | None = None
    agreeing: float | None = None

    @property
    def details(self) -> Mapping[str, float]:
        """The figures that are recorded beside an estimate."""
        refined = {
            "residual": self.residual,
            "iterations": self.iterations,
            "fitting": self.fitting,
            "agreeing": self.agreeing,
        }
        known = {name: float(value) for name, value in refined.items() if value is not None}
        return known | {"replaced": self.replaced}


@dataclass(frozen=True, slots=True)
class Disagreement:
    """The picture has no one motion, so that nothing was moved.

    Attributes
    ----------
    agreeing : float
        Share of the sub-areas that agree with the best motion.
    fitting : float
        Share of the remembered pixels that look as remembered after it.
    """

    agreeing: float
    fitting: float

    @property
    def reason(self) -> str:
        """Why there is no motion, in a few words."""
        return (
            f"no consensus: {100 * self.agreeing:.0f} % of the sub-areas agree, {100 * self.fitting:.0f} % of the"
            " remembered pixels are seen again (covered, wet, in another light, or not only the ground in view)"
        )


class PredictedMove(NamedTuple):
    """The centre of a group's search.

    Attributes
    ----------
    shift : (float, float)
        Of the group's centre along u and v [px].
    turn_rad : float
        Of the group [rad].
    """

    shift: tuple[float, float]
    turn_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class TwoViews:
    """The two viewpoints of Eq. (3).

    Attributes
    ----------
    lower, upper : Viewpoint
        Tracking areas with their groups.
    distance_px : float
        D, the distance of their centres [px].
    aspect : float
        Metres per pixel along v over those along u.
    """

    lower: Viewpoint
    upper: Viewpoint
    distance_px: float
    aspect: float

    def begin(self, picture: SearchPicture, n_pixels: int) -> None:
        """Choose the reference pixels of both groups in a picture."""
        self.lower.begin(picture, n_pixels)
        self.upper.begin(picture, n_pixels)

    def advance(self, picture: SearchPicture, lower: ImageMotion, upper: ImageMotion, grid: float) -> float:
        """Move both groups with the picture; returns the mean share of pixels that jumped."""
        jumped = self.lower.advance(picture, lower, grid), self.upper.advance(picture, upper, grid)
        return sum(jumped) / 2

    def combine(self, matches: MatchPair) -> ImageMotion:
        """Return the motion about the middle of both, Eq. (3)."""
        first, second = ((match.motion.u, match.motion.v) for match in matches)
        return combine(first, second, self.distance_px, self.aspect)


class MoveStrategy(ABC):
    """One way from a picture and its matches to a motion.

    Parameters
    ----------
    config : GroundVOConfig
        Parameters of the paper, and of what was added.
    views : TwoViews
        The viewpoints; the strategy moves them.
    kernels : Kernels
        The build to use.
    max_shift_px : int
        Largest shift that is predicted [px].
    """

    def __init__(self, config: GroundVOConfig, views: TwoViews, kernels: Kernels, *, max_shift_px: int) -> None:
        self._config = config
        self._max_shift_px = max_shift_px
        self._views = views
        self._kernels = kernels

    @abstractmethod
    def prepare(self, image: Grey8) -> SearchPicture:
        """Return a picture in the forms that search and move read."""

    @abstractmethod
    def move(
        self, picture: SearchPicture, matches: MatchPair, guesses: Sequence[ImageMotion] = ()
    ) -> GroupMove | Disagreement:
        """Return the motion of the matches, and move the remembered pixels with it.

        Parameters
        ----------
        picture : SearchPicture
            Of `prepare`.
        matches : (GroupMatch, GroupMatch)
            Of the lower and of the upper group.
        guesses : sequence of ImageMotion
            Other motions that may be right, for strategies that weigh them.
        """

    def begin(self, picture: SearchPicture) -> None:
        """Choose what is remembered in a picture."""
        self._views.begin(picture, self._config.n_pixels)

    def predict(self, last: ImageMotion, pace: float) -> PredictedMove:
        """Return where a group is searched for that moved by `last`, `pace` times as long ago."""
        # Differs from the paper: scaled by the time between pictures, so that a dropped one does not lose the track
        limit = self._max_shift_px
        u, v = (float(min(max(round(pace * part), -limit), limit)) for part in (last.u, last.v))
        return PredictedMove((u, v))

    def find(self, viewpoint: Viewpoint, picture: SearchPicture, predicted: PredictedMove) -> GroupMatch:
        """Search for a group around a predicted shift and turn."""
        return viewpoint.find(picture, predicted.shift, predicted.turn_rad)

    def vote(self, before: SearchPicture, now: SearchPicture) -> ShiftVote | None:
        """Return the shift between two pictures by phase correlation, where the strategy computes one."""
        return None

    def new_flat_field(self) -> Float32s | None:
        """Return the flat field that was learned, (H, W) relative to its mean, when there is a new one."""
        return None

    def on_resume(self, image: Grey8) -> SearchPicture:
        """Return the first picture of another run of pictures, prepared."""
        return self.prepare(image)

    def ignore(self, weights: Grey8) -> None:  # noqa: B027 - most strategies look at all pixels
        """Count pixels by these weights from now on."""

    def on_flat_field(self) -> None:  # noqa: B027 - most strategies do not ask how even the light is
        """Take the light for even from now on."""


class WholePixelMove(MoveStrategy):
    """Moves each group by its own match, as the paper does."""

    def prepare(self, image: Grey8) -> SearchPicture:
        """Return the picture and its transpose."""
        return SearchPicture(image, self._kernels.transpose(image))

    def move(self, picture: SearchPicture, matches: MatchPair, guesses: Sequence[ImageMotion] = ()) -> GroupMove:
        """Return Eq. (3), and move each group by its own match."""
        grid = _PAPER_GRID if self._config.mode == "whole_pixels" else 0.0
        lower, upper = matches
        replaced = self._views.advance(picture, lower.motion, upper.motion, grid)
        alignment = whole_pixel_information(
            lower.covariance, upper.covariance, self._views.distance_px, self._views.aspect
        )
        information = drift_information(alignment, replaced, _GROWTH_WHOLE_PIXELS)
        return GroupMove(self._views.combine(matches), lower.motion, upper.motion, information, replaced)


class PyramidMove(WholePixelMove):
    """The same, searched at half resolution first."""

    def prepare(self, image: Grey8) -> SearchPicture:
        """Return the picture and its half, with their transposes."""
        half = half_picture(image)
        return SearchPicture(image, self._kernels.transpose(image), half, self._kernels.transpose(half))

    def find(self, viewpoint: Viewpoint, picture: SearchPicture, predicted: PredictedMove) -> GroupMatch:
        """Search at half resolution with every second turn, then finely around what was found."""
        return viewpoint.find_in_pyramid(picture, predicted.shift)
