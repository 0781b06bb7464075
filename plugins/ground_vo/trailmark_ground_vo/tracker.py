"""The relative search of Nagai & Watanabe (2015), picture by picture: Sec. II-A as a flow chart."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from statistics import median

import numpy as np
import numpy.typing as npt

from trailmark.errors import ConfigError
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.extremes import Area
from trailmark_ground_vo.filters import levels_of, noise_level
from trailmark_ground_vo.kernels import load_kernels
from trailmark_ground_vo.motion import ImageMotion, combine
from trailmark_ground_vo.refinement import Refinement
from trailmark_ground_vo.uncertainty import drift_information, whole_pixel_information
from trailmark_ground_vo.viewpoint import Match, Picture, SearchRange, Viewpoint

__all__ = ["Miss", "RelativeTracker", "Step", "tracking_areas"]

Grey = npt.NDArray[np.uint8]
Matrix = npt.NDArray[np.float64]

#: The picture that the paper's figures are for: height less its rim, and D with and without overlapping areas.
_PAPER_ROWS, _PAPER_DISTANCE, _DISJOINT_DISTANCE = 352, 128, 192

#: Bits after the point of the paper's coordinates: 9.7 fixed point.
_PAPER_GRID = 128.0

#: Without a motion to predict with.
_STILL = (ImageMotion(0.0, 0.0, 0.0), ImageMotion(0.0, 0.0, 0.0))

#: Pictures whose error says what is usual.
_USUAL_FRAMES = 50

#: Error on a smoothed picture per noise of the picture that may be noise: twice what was measured on eight floors.
_NOISE_FACTOR = 0.8

#: An error so many times what it has been is no surprise.
_USUAL_FACTOR = 1.5

#: Errors below this say nothing: light that changes by two percent does as much [grey levels].
_QUIET_LEVELS = 3.0

#: Drift variance per replacement of all pixels over that of one alignment, measured on ten floors (see README.md).
_GROWTH_WHOLE_PIXELS, _GROWTH_REFINED = 0.15, 2.5


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """The motion of the content from the picture before.

    Attributes
    ----------
    since_s : float
        Stamp of that picture [s].
    motion : ImageMotion
        About the middle of the picture.
    information : (3, 3) float64
        Of (u, v, turn) [1/px^2, 1/px^2, 1/rad^2 on the diagonal].
    details : mapping of str to float
        Errors, spread of the turns, share of replaced pixels, iterations.
    """

    since_s: float
    motion: ImageMotion
    information: Matrix
    details: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Miss:
    """The picture does not fit to what is remembered.

    Attributes
    ----------
    reason : str
        Why, in a few words.
    details : mapping of str to float
        The errors that say so.
    """

    reason: str
    details: Mapping[str, float]


def tracking_areas(config: GroundVOConfig, size: tuple[int, int]) -> tuple[tuple[Area, Area], int]:
    """Return the two tracking areas, the lower one first, and D, the distance of their centres [px].

    Raises
    ------
    ConfigError
        If the picture is too small for them, or the rim too narrow for the search.
    """
    width, height = size
    margin, rows = config.margin_px, height - 2 * config.margin_px
    paper_px = _PAPER_DISTANCE if config.mode == "paper" else _DISJOINT_DISTANCE
    distance_px = config.centre_distance_px or round(rows * paper_px / _PAPER_ROWS)
    high = rows - distance_px
    if width - 2 * margin < 32 or high < 16:
        raise ConfigError(
            f"pictures of {width} x {height} are too small for a rim of {margin} px (margin_px) and viewpoints"
            f" {distance_px} px apart (centre_distance_px): each tracking area needs 32 x 16 px"
        )
    turned_px = math.radians(config.rotation_steps * config.rotation_step_deg) * (width / 2 - margin)
    needed = math.ceil(config.max_shift_px + config.search_px + turned_px)
    if margin < needed:
        raise ConfigError(
            f"margin_px is {margin}, but shifts of {config.max_shift_px} + {config.search_px} px and turns of"
            f" {config.rotation_steps} x {config.rotation_step_deg:.3g} deg reach {needed} px"
        )
    upper: Area = (margin, margin, width - margin, margin + high)
    lower: Area = (margin, margin + distance_px, width - margin, margin + distance_px + high)
    return (lower, upper), distance_px


def _wide_shifts(config: GroundVOConfig) -> list[tuple[float, float]]:
    """Return predictions whose searches together cover all shifts, the small ones first."""
    limit = config.max_shift_px
    count = math.ceil(limit / config.search_px) + 1
    along = [float(round(shift)) for shift in np.linspace(-limit, limit, count)]
    return sorted(product(along, along), key=lambda shift: shift[0] ** 2 + shift[1] ** 2)


class RelativeTracker:
    """Follows the ground from picture to picture.

    Parameters
    ----------
    config : GroundVOConfig
        Parameters of the paper, and of what was added.
    size : (int, int)
        Width and height of the pictures [px].
    aspect : float
        Metres per pixel along v over those along u.
    """

    def __init__(self, config: GroundVOConfig, size: tuple[int, int], aspect: float = 1.0) -> None:
        self._config = config
        self._aspect = aspect
        self._kernels = load_kernels(config.use_vectors)
        areas, self._distance_px = tracking_areas(config, size)
        step_rad = math.radians(config.rotation_step_deg)
        search = SearchRange(config.search_px, config.rotation_steps, step_rad)
        lower, upper = (Viewpoint(area, search, aspect, self._kernels) for area in areas)
        self._viewpoints = (lower, upper)
        self._middle = ((size[0] - 1) / 2.0, (size[1] - 1) / 2.0)
        self._wide_shifts = _wide_shifts(config)
        self._refinement = Refinement(config, size, aspect) if config.mode == "refined" else None
        self._is_smooth = bool(config.smooth_search)
        self._since_s: float | None = None
        self._interval_s = 0.0
        self._n_missed = 0
        self._last: tuple[ImageMotion, ImageMotion] | None = None
        self._usual: deque[float] = deque(maxlen=_USUAL_FRAMES)

    def step(self, image: Grey, stamp_s: float) -> Step | Miss | None:
        """Compare a picture with what is remembered of the ones before.

        Parameters
        ----------
        image : (H, W) uint8
            The next picture.
        stamp_s : float
            Its stamp, later than the last one's [s].

        Returns
        -------
        Step, Miss or None
            None for the first picture.
        """
        picture = self._picture(image)
        if self._since_s is None:
            self._begin(picture, stamp_s)
            return None
        elapsed_s = stamp_s - self._since_s
        matches = self._find(picture, elapsed_s / self._interval_s if self._interval_s > 0.0 else 1.0)
        details, reason = self._details(matches), self._why_lost(matches, picture.noise)
        if reason:
            self._miss(picture, stamp_s)
            return Miss(reason, details)
        move = self._move_whole_pixels if self._refinement is None else self._move_refined
        motion, information = move(picture, matches, details)
        step = Step(self._since_s, motion, information, details)
        self._usual.append(details["error"])
        self._since_s, self._interval_s, self._n_missed = stamp_s, elapsed_s, 0
        return step

    def new_flat_field(self) -> npt.NDArray[np.float32] | None:
        """Return the flat field that was learned, (H, W) relative to its mean, when there is a new one."""
        return None if self._refinement is None else self._refinement.new_flat_field()

    def refresh(self, image: Grey) -> None:
        """Choose all pixels anew, in the picture of the last step with another flat field."""
        self._is_smooth = self._config.smooth_search is not False
        self._choose(self._picture(image))

    def _miss(self, picture: Picture, stamp_s: float) -> None:
        """Wait for a better picture, but not for long: what is remembered gets out of reach."""
        self._n_missed += 1
        if self._n_missed > self._config.patience_frames:
            self._begin(picture, stamp_s)

    def _choose(self, picture: Picture) -> None:
        for viewpoint in self._viewpoints:
            viewpoint.begin(picture, self._config.n_pixels)
        if self._refinement is not None:
            assert picture.smoothed is not None
            self._refinement.begin(picture.smoothed)

    def _begin(self, picture: Picture, stamp_s: float) -> None:
        self._choose(picture)
        self._since_s, self._interval_s, self._n_missed, self._last = stamp_s, 0.0, 0, None
        self._usual.clear()

    def _picture(self, image: Grey) -> Picture:
        if self._refinement is not None:
            smoothed, noise = self._kernels.smooth(image), None
            if self._is_smooth:
                image, noise = levels_of(smoothed), noise_level(image)
            return Picture(image, self._kernels.transpose(image), smoothed=smoothed, noise=noise)
        image_t = self._kernels.transpose(image)
        if self._config.mode != "pyramid":
            return Picture(image, image_t)
        import cv2

        height, width = image.shape
        half = np.asarray(cv2.resize(image, (width // 2, height // 2), interpolation=cv2.INTER_AREA), np.uint8)
        return Picture(image, image_t, half, self._kernels.transpose(half))

    def _find(self, picture: Picture, pace: float) -> tuple[Match, Match]:
        if self._last is None:
            return self._find_anywhere(picture) if self._config.wide_search else self._find_near(picture, _STILL, 1.0)
        matches = self._find_near(picture, self._last, pace)
        if self._config.wide_search and self._why_lost(matches, picture.noise):
            return self._find_anywhere(picture)
        return matches

    def _find_near(self, picture: Picture, last: tuple[ImageMotion, ImageMotion], pace: float) -> tuple[Match, Match]:
        lower, upper = (
            self._find_at(viewpoint, picture, self._predicted(motion, pace))
            for viewpoint, motion in zip(self._viewpoints, last)
        )
        return lower, upper

    def _predicted(self, last: ImageMotion, pace: float) -> tuple[float, float]:
        # Differs from the paper: scaled by the time between pictures, so that a dropped one does not lose the track
        limit = self._config.max_shift_px
        u, v = (float(min(max(round(pace * part), -limit), limit)) for part in (last.u, last.v))
        return u, v

    def _find_at(self, viewpoint: Viewpoint, picture: Picture, shift: tuple[float, float]) -> Match:
        if picture.half is None:
            return viewpoint.find(picture, shift)
        return viewpoint.find_in_pyramid(picture, shift)

    def _find_anywhere(self, picture: Picture) -> tuple[Match, Match]:
        lower, upper = self._viewpoints
        tried = [lower.find(picture, shift) for shift in self._wide_shifts]
        first = min(tried, key=lambda match: match.error)
        return first, upper.find(picture, self._predicted(first.motion, 1.0))

    def _why_lost(self, matches: tuple[Match, Match], noise: float | None) -> str:
        error, mean = (sum(getattr(match, part) for match in matches) / 2 for part in ("error", "mean_error"))
        if error > self._most(mean, noise) or mean == 0.0:
            return f"no match: error {error:.1f} of {mean:.1f} grey levels (blank, covered, blurred or too fast)"
        usual = max(_QUIET_LEVELS, median(self._usual)) if self._usual else math.inf
        if error > self._config.max_error_growth * usual:
            return f"bad match: error {error:.1f} grey levels, usually {usual:.1f} (covered, blurred or too fast)"
        return ""

    def _most(self, mean: float, noise: float | None) -> float:
        """Return the largest error of a match: what noise explains, and a share of what any place would give."""
        most = self._config.max_error_ratio * mean
        if noise is None:
            return most
        usual = _USUAL_FACTOR * median(self._usual) if self._usual else 0.0
        return min(most, max(self._config.max_error_share * mean + _NOISE_FACTOR * noise, usual))

    def _move_whole_pixels(
        self, picture: Picture, matches: tuple[Match, Match], details: dict[str, float]
    ) -> tuple[ImageMotion, Matrix]:
        """Move each group by its own match, as the paper does."""
        grid = _PAPER_GRID if self._config.mode == "paper" else 0.0
        replaced = [v.advance(picture, match.motion, grid) for v, match in zip(self._viewpoints, matches)]
        self._last = (matches[0].motion, matches[1].motion)
        details["replaced"] = sum(replaced) / 2
        lower, upper = matches[0].covariance, matches[1].covariance
        alignment = whole_pixel_information(lower, upper, self._distance_px, self._aspect)
        return self._combined(matches), drift_information(alignment, details["replaced"], _GROWTH_WHOLE_PIXELS)

    def _move_refined(
        self, picture: Picture, matches: tuple[Match, Match], details: dict[str, float]
    ) -> tuple[ImageMotion, Matrix]:
        """Refine the matches and move both groups like one rigid body."""
        assert self._refinement is not None
        assert picture.smoothed is not None
        found = self._combined(matches)
        mean_turn = (matches[0].motion.turn_rad + matches[1].motion.turn_rad) / 2
        starts = [found, ImageMotion(found.u, found.v, mean_turn), ImageMotion(found.u, found.v, 0.0)]
        aligned = self._refinement.align(picture.smoothed, starts)
        offsets = [viewpoint.centre[1] - self._middle[1] for viewpoint in self._viewpoints]
        lower, upper = (aligned.motion.about(0.0, offset, self._aspect) for offset in offsets)
        for viewpoint, motion in zip(self._viewpoints, (lower, upper)):
            viewpoint.advance(picture, motion, 0.0)
        self._last = (lower, upper)
        details |= aligned.details
        return aligned.motion, drift_information(aligned.information, details["replaced"], _GROWTH_REFINED)

    def _combined(self, matches: tuple[Match, Match]) -> ImageMotion:
        first, second = ((match.motion.u, match.motion.v) for match in matches)
        return combine(first, second, self._distance_px, self._aspect)

    def _details(self, matches: tuple[Match, Match]) -> dict[str, float]:
        turns = [*(match.motion.turn_rad for match in matches), self._combined(matches).turn_rad]
        error, mean = (sum(getattr(match, part) for match in matches) / 2 for part in ("error", "mean_error"))
        return {
            "error": error,
            "error_ratio": error / mean if mean > 0.0 else 1.0,
            "turn_spread_deg": math.degrees(max(turns) - min(turns)),
        }
