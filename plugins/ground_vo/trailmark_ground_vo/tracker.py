"""The relative search of Nagai & Watanabe (2015), picture by picture: Sec. II-A as a flow chart."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from trailmark.arrays import Float32s, Floats, Grey8
from trailmark_ground_vo.areas import tracking_areas, wide_shifts
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.judging import MatchJudge, MatchPair, mean_error
from trailmark_ground_vo.kernels import load_kernels
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.moves import MoveStrategy, PyramidMove, RefinedMove, TwoViews, WholePixelMove
from trailmark_ground_vo.viewpoint import SearchPicture, SearchRange, Viewpoint

__all__ = ["RelativeTracker", "TrackedMotion", "TrackingFailure"]

#: Without a motion to predict with.
_STILL = (ImageMotion(0.0, 0.0, 0.0), ImageMotion(0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class TrackedMotion:
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
    information: Floats
    details: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class TrackingFailure:
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
        self._views = _two_views(config, size, aspect)
        self._strategy = _strategy(config, size, self._views)
        self._judge = MatchJudge(config)
        self._wide_shifts = wide_shifts(config)
        self._since_s: float | None = None
        self._interval_s = 0.0
        self._n_missed = 0
        self._last: tuple[ImageMotion, ImageMotion] | None = None

    def step(self, image: Grey8, stamp_s: float) -> TrackedMotion | TrackingFailure | None:
        """Compare a picture with what is remembered of the ones before.

        Parameters
        ----------
        image : (H, W) uint8
            The next picture.
        stamp_s : float
            Its stamp, later than the last one's [s].

        Returns
        -------
        TrackedMotion, TrackingFailure or None
            None for the first picture.
        """
        picture = self._strategy.prepare(image)
        if self._since_s is None:
            self._begin(picture, stamp_s)
            return None
        elapsed_s = stamp_s - self._since_s
        matches = self._find(picture, elapsed_s / self._interval_s if self._interval_s > 0.0 else 1.0)
        details, reason = self._search_details(matches), self._judge.reason_lost(matches, picture.noise)
        if reason:
            self._miss(picture, stamp_s)
            return TrackingFailure(reason, details)
        moved = self._strategy.move(picture, matches)
        tracked = TrackedMotion(self._since_s, moved.motion, moved.information, {**details, **moved.details})
        self._judge.accept(matches)
        self._last = (moved.lower, moved.upper)
        self._since_s, self._interval_s, self._n_missed = stamp_s, elapsed_s, 0
        return tracked

    def new_flat_field(self) -> Float32s | None:
        """Return the flat field that was learned, (H, W) relative to its mean, when there is a new one."""
        return self._strategy.new_flat_field()

    def refresh(self, image: Grey8) -> None:
        """Choose all pixels anew, in the picture of the last step with another flat field."""
        self._strategy.on_flat_field()
        self._strategy.begin(self._strategy.prepare(image))

    def _miss(self, picture: SearchPicture, stamp_s: float) -> None:
        """Wait for a better picture, but not for long: what is remembered gets out of reach."""
        self._n_missed += 1
        if self._n_missed > self._config.patience_frames:
            self._begin(picture, stamp_s)

    def _begin(self, picture: SearchPicture, stamp_s: float) -> None:
        self._strategy.begin(picture)
        self._since_s, self._interval_s, self._n_missed, self._last = stamp_s, 0.0, 0, None
        self._judge.forget()

    def _find(self, picture: SearchPicture, pace: float) -> MatchPair:
        if self._last is None:
            return self._find_anywhere(picture) if self._config.wide_search else self._find_near(picture, _STILL, 1.0)
        matches = self._find_near(picture, self._last, pace)
        if self._config.wide_search and self._judge.reason_lost(matches, picture.noise):
            return self._find_anywhere(picture)
        return matches

    def _find_near(self, picture: SearchPicture, last: tuple[ImageMotion, ImageMotion], pace: float) -> MatchPair:
        lower, upper = (
            self._strategy.find(viewpoint, picture, self._predicted(motion, pace))
            for viewpoint, motion in zip((self._views.lower, self._views.upper), last)
        )
        return lower, upper

    def _predicted(self, last: ImageMotion, pace: float) -> tuple[float, float]:
        # Differs from the paper: scaled by the time between pictures, so that a dropped one does not lose the track
        limit = self._config.max_shift_px
        u, v = (float(min(max(round(pace * part), -limit), limit)) for part in (last.u, last.v))
        return u, v

    def _find_anywhere(self, picture: SearchPicture) -> MatchPair:
        tried = [self._views.lower.find(picture, shift) for shift in self._wide_shifts]
        first = min(tried, key=lambda match: match.error)
        return first, self._views.upper.find(picture, self._predicted(first.motion, 1.0))

    def _search_details(self, matches: MatchPair) -> dict[str, float]:
        turns = [*(match.motion.turn_rad for match in matches), self._views.combine(matches).turn_rad]
        error, mean = mean_error(matches), (matches[0].mean_error + matches[1].mean_error) / 2
        return {
            "error": error,
            "error_ratio": error / mean if mean > 0.0 else 1.0,
            "turn_spread_deg": math.degrees(max(turns) - min(turns)),
        }


def _two_views(config: GroundVOConfig, size: tuple[int, int], aspect: float) -> TwoViews:
    areas, distance_px = tracking_areas(config, size)
    search = SearchRange(config.search_px, config.rotation_steps, math.radians(config.rotation_step_deg))
    lower, upper = (Viewpoint(area, search, aspect, load_kernels(config.use_vectors)) for area in areas)
    return TwoViews(lower, upper, distance_px, aspect)


def _strategy(config: GroundVOConfig, size: tuple[int, int], views: TwoViews) -> MoveStrategy:
    kernels = load_kernels(config.use_vectors)
    if config.mode == "refined":
        return RefinedMove(config, views, kernels, size)
    return (PyramidMove if config.mode == "pyramid" else WholePixelMove)(config, views, kernels)
