"""The relative search of Nagai & Watanabe (2015), picture by picture: Sec. II-A as a flow chart."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from trailmark.arrays import Float32s, Floats, Grey8
from trailmark_ground_vo.areas import max_shift_px, tracking_areas, wide_shifts
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.judging import MatchJudge, MatchPair, mean_error
from trailmark_ground_vo.kernels import load_kernels
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.moves import (
    Disagreement,
    MoveStrategy,
    PyramidMove,
    TwoViews,
    WholePixelMove,
)
from trailmark_ground_vo.refined_moves import GuardedMove, RefinedMove
from trailmark_ground_vo.viewpoint import SearchPicture, SearchRange, Viewpoint
from trailmark_ground_vo.witness import ShiftVote

__all__ = ["RelativeTracker", "TrackedMotion", "TrackingFailure"]

#: Support of the second opinion that a motion needs, of that of the best shift.
_LEAST_SUPPORT = 0.5

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
    is_guarded : bool
        In mode refined: trust neither the light nor a single opinion.
    """

    def __init__(
        self, config: GroundVOConfig, size: tuple[int, int], aspect: float = 1.0, *, is_guarded: bool = False
    ) -> None:
        self._config = config
        self._views = _two_views(config, size, aspect)
        self._strategy = _strategy(config, size, self._views, is_guarded=is_guarded)
        self._judge = MatchJudge(config, max_shift_px(config, size, is_guarded=is_guarded))
        self._wide_shifts = wide_shifts(config, size)
        self._since_s: float | None = None
        self._interval_s = 0.0
        self._n_missed = 0
        self._last: tuple[ImageMotion, ImageMotion] | None = None
        self._reference: SearchPicture | None = None
        self._latest: SearchPicture | None = None
        self._latest_vote: ShiftVote | None = None
        self.has_begun_anew = False

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
        self._latest = picture = self._strategy.prepare(image)
        self.has_begun_anew = False
        if self._since_s is None:
            self._begin(picture, stamp_s)
            return None
        elapsed_s = stamp_s - self._since_s
        pace = elapsed_s / self._interval_s if self._interval_s > 0.0 else 1.0
        vote = self._latest_vote = self._vote(picture)
        matches = self._find(picture, pace, vote)
        details, doubt = self._search_details(matches), self._judge.reason_lost(matches, picture.noise)
        if doubt and (vote is None or not vote.is_clear):
            return self._miss(picture, stamp_s, TrackingFailure(doubt, details))
        found = self._views.combine(matches)
        reason = self._reason_contradicted(found, vote) if not doubt else ""
        if reason:
            return self._miss(picture, stamp_s, TrackingFailure(reason, details))
        guesses = [] if vote is None else [ImageMotion(vote.u, vote.v, self._turn_rad(pace))]
        moved = self._strategy.move(picture, matches, guesses)
        if isinstance(moved, Disagreement):
            return self._miss(picture, stamp_s, TrackingFailure(doubt or moved.reason, details))
        tracked = TrackedMotion(self._since_s, moved.motion, moved.information, {**details, **moved.details})
        if not doubt:
            self._judge.accept(matches)
        self._last, self._reference = (moved.lower, moved.upper), picture
        self._since_s, self._interval_s, self._n_missed = stamp_s, elapsed_s, 0
        return tracked

    def resume(self, image: Grey8, stamp_s: float, interval_s: float, last: ImageMotion | None) -> None:
        """Go on from a picture that another tracker has understood.

        Parameters
        ----------
        image : (H, W) uint8
            That picture.
        stamp_s, interval_s : float
            Its stamp, and the time since the picture before [s].
        last : ImageMotion or None
            How the content moved in that time.
        """
        self._latest = self._strategy.on_resume(image)
        self._begin(self._latest, stamp_s)
        self._last = None if last is None else self._of_groups(last)
        self._interval_s, self.has_begun_anew = interval_s, False

    @property
    def interval_s(self) -> float:
        """Time between the last two pictures that were understood; 0 before [s]."""
        return self._interval_s

    @property
    def since_s(self) -> float | None:
        """Stamp of the picture that the next one is compared with; None before the first [s]."""
        return self._since_s

    @property
    def latest(self) -> SearchPicture | None:
        """The last picture, understood or not; None before the first."""
        return self._latest

    @property
    def latest_vote(self) -> ShiftVote | None:
        """What phase correlation said of the last picture; None where it was not asked."""
        return self._latest_vote

    @property
    def reference(self) -> SearchPicture | None:
        """The last picture that was understood; None before the first."""
        return self._reference

    def new_flat_field(self) -> Float32s | None:
        """Return the flat field that was learned, (H, W) relative to its mean, when there is a new one."""
        return self._strategy.new_flat_field()

    def refresh(self, image: Grey8) -> None:
        """Choose all pixels anew, in the picture of the last step with another flat field."""
        self._strategy.on_flat_field()
        self._reference = self._strategy.prepare(image)
        self._strategy.begin(self._reference)

    def ignore(self, weights: Grey8) -> None:
        """Count pixels by these weights, (H, W) uint8, from the next picture on: some are fixed to the lens."""
        self._strategy.ignore(weights)

    def _miss(self, picture: SearchPicture, stamp_s: float, failure: TrackingFailure) -> TrackingFailure:
        """Wait for a better picture, but not for long: what is remembered gets out of reach."""
        self._n_missed += 1
        if self._n_missed > self._config.patience_frames:
            self._begin(picture, stamp_s)
        return failure

    def _begin(self, picture: SearchPicture, stamp_s: float) -> None:
        self._strategy.begin(picture)
        self._since_s, self._interval_s, self._n_missed, self._last = stamp_s, 0.0, 0, None
        self._reference, self.has_begun_anew = picture, True
        self._judge.forget()

    def _vote(self, picture: SearchPicture) -> ShiftVote | None:
        if self._reference is None or not self._config.wide_search:
            return None
        return self._strategy.vote(self._reference, picture)

    def _find(self, picture: SearchPicture, pace: float, vote: ShiftVote | None) -> MatchPair:
        if vote is not None and vote.is_clear and not self._is_predicted(vote, pace):
            return self._find_around(picture, vote, pace)
        if self._last is None:
            return self._find_anywhere(picture) if self._config.wide_search else self._find_near(picture, _STILL, 1.0)
        matches = self._find_near(picture, self._last, pace)
        if self._config.wide_search and self._judge.reason_lost(matches, picture.noise):
            return self._find_anywhere(picture)
        return matches

    def _is_predicted(self, vote: ShiftVote, pace: float) -> bool:
        """Return whether a vote is so near to what is predicted that the search around that will find it."""
        if self._last is None:
            return False
        shifts = [self._strategy.predict(motion, pace).shift for motion in self._last]
        u, v = sum(shift[0] for shift in shifts) / 2, sum(shift[1] for shift in shifts) / 2
        return max(abs(u - vote.u), abs(v - vote.v)) <= self._config.search_px / 2

    def _find_around(self, picture: SearchPicture, vote: ShiftVote, pace: float) -> MatchPair:
        """Search for both groups around the shift of phase correlation, turned as predicted."""
        guess = ImageMotion(vote.u, vote.v, self._turn_rad(pace))
        lower, upper = (
            self._strategy.find(viewpoint, picture, self._strategy.predict(motion, 1.0))
            for viewpoint, motion in zip((self._views.lower, self._views.upper), self._of_groups(guess))
        )
        return lower, upper

    def _of_groups(self, motion: ImageMotion) -> tuple[ImageMotion, ImageMotion]:
        """Return a motion about the middle of the picture as those about the centres of both groups."""
        half = self._views.distance_px / 2.0
        return motion.about(0.0, half, self._views.aspect), motion.about(0.0, -half, self._views.aspect)

    def _turn_rad(self, pace: float) -> float:
        """Return the turn that is predicted."""
        return 0.0 if self._last is None else pace * self._last[0].turn_rad

    def _reason_contradicted(self, found: ImageMotion, vote: ShiftVote | None) -> str:
        """Return why phase correlation contradicts a motion; empty when it does not."""
        if vote is None or vote.support(found.u, found.v) >= _LEAST_SUPPORT:
            return ""
        return (
            f"two answers: the search found a shift of {found.u:.0f}, {found.v:.0f} px, phase correlation"
            f" {vote.u:.0f}, {vote.v:.0f} px (something else than the ground in view)"
        )

    def _find_near(self, picture: SearchPicture, last: tuple[ImageMotion, ImageMotion], pace: float) -> MatchPair:
        lower, upper = (
            self._strategy.find(viewpoint, picture, self._strategy.predict(motion, pace))
            for viewpoint, motion in zip((self._views.lower, self._views.upper), last)
        )
        return lower, upper

    def _find_anywhere(self, picture: SearchPicture) -> MatchPair:
        tried = [self._views.lower.find(picture, shift) for shift in self._wide_shifts]
        first = min(tried, key=lambda match: match.error)
        return first, self._views.upper.find(picture, self._strategy.predict(first.motion, 1.0).shift)

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


def _strategy(config: GroundVOConfig, size: tuple[int, int], views: TwoViews, *, is_guarded: bool) -> MoveStrategy:
    kernels, limit_px = load_kernels(config.use_vectors), max_shift_px(config, size, is_guarded=is_guarded)
    if config.mode == "refined":
        made = GuardedMove if is_guarded else RefinedMove
        return made(config, views, kernels, max_shift_px=limit_px, size=size)
    return (PyramidMove if config.mode == "pyramid" else WholePixelMove)(config, views, kernels, max_shift_px=limit_px)
