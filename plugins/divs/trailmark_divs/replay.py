"""Replaying a taught path: looks in, offsets from the path out."""

from __future__ import annotations

import math
from dataclasses import replace

from trailmark.estimates import Belief, Estimate, Lost, PathOffset, information_along
from trailmark.geometry import wrap_angle
from trailmark.paths import Path
from trailmark_divs.appearance import AppearanceFilter, ByAppearance
from trailmark_divs.config import DivsConfig
from trailmark_divs.correspondence import Correspondence, Match, direction, make_correspondence
from trailmark_divs.drift import DriftLaw, GainLearner
from trailmark_divs.eye import TURNING, DifferenceWindow, Look
from trailmark_divs.glance import Glances
from trailmark_divs.landmarks import AtLandmarks, distinct_rows, sameness
from trailmark_divs.layout import ColumnLayout
from trailmark_divs.paper_shift import PaperShift
from trailmark_divs.pictures import PictureShift, PictureShifts
from trailmark_divs.place_fit import PlaceFit
from trailmark_divs.places import PicturePlaces
from trailmark_divs.robust_shift import local_windows, shift_scores
from trailmark_divs.stream import n_trimmed
from trailmark_divs.taught_stream import TaughtStream
from trailmark_divs.tracking import ShiftTracker, TrackedShift
from trailmark_divs.windows import Windows

__all__ = ["StreamMatcher"]

_GLANCE_SIGMAS = 2.0  # a single picture is this much less certain than a window
# Beside the path, one wall looks as if the robot were farther along, the other as if less far: which of them wins
# is luck. In a corridor 2.4 m wide, 0.15 m aside moved the match by up to 0.4 m.
_STATION_PER_LATERAL = 2.0
# Some taught picture is always the most alike. Where the present place was among them, the best of them scored 0.31 or
# more and stood out by 6.5 sigmas or more; where it was of another kind of place, 0.21 and 4.8 at most.
_PLACE_SCORE, _PLACE_SIGMAS = 0.25, 5.0


class StreamMatcher:
    """Compares what is seen with what was taught.

    Parameters
    ----------
    config : DivsConfig
        Config.
    layout : ColumnLayout
        Region and columns of the camera's pictures.
    recording : TaughtStream
        What was taught.
    path : Path
        The taught path.
    law : DriftLaw
        What a shift is worth.
    radians_per_column : float
        Angle of a column [rad].
    start_s : float
        Stamp of the first picture [s].
    """

    def __init__(
        self,
        config: DivsConfig,
        layout: ColumnLayout,
        recording: TaughtStream,
        path: Path,
        law: DriftLaw,
        radians_per_column: float,
        start_s: float,
    ) -> None:
        self._config = config
        self._layout = layout
        self._path = path
        self._law = law
        self._radians_per_column = radians_per_column
        self._start_s = start_s
        cut = n_trimmed(config.window, config.average)
        self._windows = Windows.of(recording, config.window, cut, layout.scale)
        self._correspondence = _correspondence(config, layout, self._windows, start_s)
        span = config.correlation_window, config.max_shift_columns
        self._glances = Glances(recording, config.correspondence, layout.usable, *span)
        columns_per_width = layout.width_px / layout.column_px
        self._pictures = PictureShifts(
            recording,
            self._glances,
            columns_per_width=columns_per_width,
            radians_per_column=radians_per_column,
            max_shift_columns=config.max_shift_columns,
        )
        self._places = PicturePlaces(recording, config.picture_spacing_m)
        self._place_fit = PlaceFit(recording, self._pictures.reach_px, config.place_fit)
        self._tracker = ShiftTracker(config.max_shift_columns, config.window)
        self._paper = PaperShift(config.correlation_window)
        self._learner = GainLearner(law.columns_per_rad or 1.0 / radians_per_column, config.sigma_columns)
        self._relative_rad: float | None = None  # heading less the taught one, at the last comparison
        self._has_been_full = False

    def answer(
        self,
        look: Look,
        window: DifferenceWindow | None,
        belief: Belief,
        *,
        are_turns_measured: bool = False,
        is_winding: bool = False,
    ) -> Estimate:
        """Return the offset from the path, or why there is none.

        Parameters
        ----------
        look : Look
            The newest look.
        window : DifferenceWindow or None
            The window that ends with it, when there is a full one.
        belief : Belief
            What is believed at the newer picture of the look.
        are_turns_measured : bool
            The belief tells of turns, so that they need not be seen in the shift.
        is_winding : bool
            The view swings, and the stream sees an average of it: clear pictures are the surer.
        """
        # A gain that is still to be learned says little of what a turn does to the shift.
        self._tracker.are_turns_measured = are_turns_measured and self._config.gain != "learned"
        picture = self._compare_picture(look, belief)
        found = self._find_place(look, belief)
        if found is not None:
            return found
        if window is None:
            is_turn = look.run == TURNING or self._has_been_full
            return self._blind(look, belief, picture, "turning" if is_turn else "the window is not full yet")
        self._has_been_full = True
        match = self._correspondence.match(window, belief)
        if match is None and self._config.correspondence == "appearance":
            return Lost(window.stamp_s, "searching the place on the path")
        if match is None:
            return self._blind(look, belief, picture, self._why_unmatched(belief))
        station_m = float(self._windows.stations_m[match.row])
        doubt = self._doubt_window(look, window, station_m, belief)
        if doubt is not None:
            return Lost(window.stamp_s, doubt)
        relative_rad = window.heading_rad - float(self._windows.headings_rad[match.row])
        self._move_tracker(relative_rad)
        shift = self._shift(match, window)
        is_clear = shift.confidence >= self._config.confidence
        if is_clear:
            self._learn(shift, relative_rad, station_m)
        if picture is not None and (is_winding or not is_clear or picture.sigma_columns < self._config.sigma_columns):
            return self._of_picture(look, belief, picture)
        if not is_clear:
            return Lost(window.stamp_s, "no clear shift", self._details(shift))
        return self._offset(window.stamp_s, station_m, shift, self._config.sigma_columns, belief, match)

    def _why_unmatched(self, belief: Belief) -> str:
        if self._config.correspondence != "distance" or belief.on_path is not None:
            return "nothing was taught here"
        if self._are_places_compared:
            return "searching the place on the path"
        return "the place on the path is not known; taught and replayed with 'when_blind: pictures' it is looked for"

    def _shift(self, match: Match, window: DifferenceWindow) -> TrackedShift:
        config, usable = self._config, self._layout.usable
        taught = self._windows.vectors[match.row]
        if config.shift == "paper":
            columns = self._paper.update(taught, window.vector)
            return TrackedShift(columns, confidence=1.0, margin=0.0, score=0.0)
        taught_windows = local_windows(taught, usable, config.correlation_window)
        seen_windows = local_windows(window.vector, usable, config.correlation_window)
        return self._tracker.update(shift_scores(taught_windows, seen_windows, config.max_shift_columns))

    def _find_place(self, look: Look, belief: Belief) -> PathOffset | Lost | None:
        """Search the place on the path by small pictures while it is unknown; None where that is switched off."""
        if belief.on_path is not None:
            self._places.restart()
            self._place_fit.restart()
            return None
        if not self._are_places_compared:
            return None
        self._places.update(look.small, look.travelled_m[1], direction(belief))
        self._place_fit.add(look, direction(belief))
        match = self._places.match(self._config.confidence)
        if match is None:
            return None
        picture = self._pictures.at_row(look, match.row)
        if picture.shift.score < _PLACE_SCORE or picture.shift.margin < _PLACE_SIGMAS:
            return None
        station_m = picture.place.station_m
        doubt = self._place_fit.doubt(station_m)
        if doubt is not None:
            return Lost(look.stamps_s[1], doubt, self._details(picture.shift))
        return self._offset(look.stamps_s[1], station_m, picture.shift, picture.sigma_columns, belief, match)

    def _doubt_window(self, look: Look, window: DifferenceWindow, station_m: float, belief: Belief) -> str | None:
        """Return a reason why a window that seems to be of a station is not, while nobody knows the place."""
        if belief.on_path is not None or not self._are_places_compared:
            return None
        since_m = look.travelled_m[1] - window.travelled_m
        return self._place_fit.doubt(station_m + direction(belief) * since_m)

    @property
    def _are_places_compared(self) -> bool:
        return self._config.when_blind == "pictures" and len(self._places) > 0

    def _compare_picture(self, look: Look, belief: Belief) -> PictureShift | None:
        """Compare the newest picture with the taught ones, where that is wanted; None where it shows nothing clear."""
        if self._config.when_blind != "pictures" or self._config.shift == "paper":
            return None
        picture = self._pictures.at_present(look, self._start_s, belief)
        return picture if picture is not None and picture.shift.confidence >= self._config.confidence else None

    def _blind(self, look: Look, belief: Belief, picture: PictureShift | None, reason: str) -> Estimate:
        """Answer without a stream."""
        return self._glance(look, belief, reason) if picture is None else self._of_picture(look, belief, picture)

    def _of_picture(self, look: Look, belief: Belief, picture: PictureShift) -> PathOffset:
        self._paper.restart()
        station_m = picture.place.station_m
        return self._offset(look.stamps_s[1], station_m, picture.shift, picture.sigma_columns, belief, None)

    def _glance(self, look: Look, belief: Belief, reason: str) -> Estimate:
        """Compare a single picture instead, where that is wanted."""
        stamp_s = look.stamps_s[1]
        self._paper.restart()
        if self._config.when_blind == "silent":
            return Lost(stamp_s, reason)
        place = self._glances.place(look, self._start_s, belief)
        if place is None:
            return Lost(stamp_s, reason)
        self._move_tracker(look.heading_rad - place.heading_rad)
        shift = self._glances.shift(look, place, self._tracker)
        if shift.confidence < self._config.confidence:
            return Lost(stamp_s, reason, self._details(shift))
        sigma_columns = _GLANCE_SIGMAS * self._config.sigma_columns
        return self._offset(stamp_s, place.station_m, shift, sigma_columns, belief, None)

    def _offset(
        self,
        stamp_s: float,
        station_m: float,
        shift: TrackedShift,
        sigma_columns: float,
        belief: Belief,
        match: Match | None,
    ) -> PathOffset:
        # Windows that overlap say nearly the same: each of the w in a row is told with w times the variance.
        overlap = math.sqrt(self._config.window)
        information = self._law.information(shift.columns, sigma_columns * overlap, self._bend(station_m))
        if match is not None and match.sigma_station_m is not None:
            aside_m = _STATION_PER_LATERAL * (0.0 if belief.on_path is None else belief.on_path.lateral_m)
            sigma_station_m = math.hypot(match.sigma_station_m * overlap, aside_m)
            information += information_along((1.0, 0.0, 0.0), sigma_station_m)
            if belief.pose_map_base is None:  # a pose to begin with needs all three numbers
                information += information_along((0.0, 1.0, 0.0), self._config.lateral_prior_m)
        heading_rad, lateral_m = self._law.drift(shift.columns)
        return PathOffset(stamp_s, station_m, lateral_m, heading_rad, information, self._details(shift))

    def _details(self, shift: TrackedShift) -> dict[str, float]:
        return {
            "shift_columns": shift.columns,
            "shift_px": shift.columns * self._layout.column_px,
            "shift_deg": math.degrees(shift.columns * self._radians_per_column),
            "confidence": shift.confidence,
            "margin": shift.margin,
            "score": shift.score,
        }

    def _bend(self, station_m: float) -> float:
        """Return how the taught heading turns, over the length of a window [rad/m]."""
        half_m = self._config.window * self._config.spacing_m / 2.0
        before, after = (self._path.pose_at(station_m + side * half_m).theta for side in (-1, 1))
        return wrap_angle(after - before) / (2.0 * half_m)

    def _move_tracker(self, relative_rad: float) -> None:
        """Move the tracked shift by the robot's turn relative to the path since the last comparison."""
        last, self._relative_rad = self._relative_rad, relative_rad
        if last is not None:
            self._tracker.move((relative_rad - last) / self._radians_per_column)

    def _learn(self, shift: TrackedShift, relative_rad: float, station_m: float) -> None:
        if self._config.gain == "learned":
            self._learner.update(shift.columns, relative_rad, station_m)
            self._law = replace(self._law, columns_per_rad=self._learner.columns_per_rad)


def _correspondence(config: DivsConfig, layout: ColumnLayout, windows: Windows, start_s: float) -> Correspondence:
    usable, e, most = layout.usable, config.correlation_window, config.max_shift_columns
    if config.correspondence == "appearance":
        places = AppearanceFilter(windows, usable, config.window, e, most, config.look_back, config.look_ahead)
        return ByAppearance(places, config.confidence)
    inner = make_correspondence(config.correspondence, windows, config.window, start_s)
    if config.landmark_spacing_m is None:
        return inner
    same = sameness(windows, usable, e, config.window, most)
    landmarks = distinct_rows(same, windows.stations_m, config.landmark_spacing_m)
    return AtLandmarks(inner, windows, landmarks, usable, config.window, e, most, config.confidence)
