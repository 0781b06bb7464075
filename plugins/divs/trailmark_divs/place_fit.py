"""Whether a place that looks the most alike is the place: how well its areas fit, over a stretch of the way.

One taught place is always the most alike, also to a robot that stands in another street or on another floor. What
tells them apart are areas: at the same place nearly all of them are found again where they belong; in another corridor
of the same plan the lamps and windows are, the posters are not. An area is compared by its patch-normalised pixels, and
may lie a few of them aside, for the robot drives beside its path. What is over-exposed shows the light, not the place.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Bools, Float32s, Floats
from trailmark.patches import patch_scores
from trailmark_divs.area_fits import area_fits
from trailmark_divs.eye import Look
from trailmark_divs.taught_stream import TaughtStream

__all__ = ["PlaceFit"]

_LEAST_AREAS = 20  # of a stretch
_STRETCH, _STEP_M = 5, 0.2  # pictures, and the way between two of them [m]
_NEAR_ROWS = 2  # wheels and the odometry of teaching differ
# Two pictures in a row fit to 0.86 to 0.93 in simulated places. Noisier cameras cannot reach what is asked of these;
# yet other streets of a like plan fit to 0.58.
_SHARE_OF_NOISE, _LOWEST_FIT = 0.955, 0.65
#: So much less must places fit that lie so far before and behind.
_RIVALS_M, _LEAST_MARGIN = (-1.6, -0.8, 0.8, 1.6), 0.02
_SAME_PICTURE = 0.98  # correlation of two pictures of which one is not new
_ROUNDING_M = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class _Kept:
    """A picture of the stretch: small, which of its pixels count, and the way driven until it [m]."""

    small: Float32s
    clear: Bools
    travelled_m: float


class PlaceFit:
    """Compares the last pictures with what was taught about a place, area by area.

    Parameters
    ----------
    recording : TaughtStream
        What was taught.
    reach_px : int
        Largest shift between a seen and a taught small picture [px].
    least_fit : float
        What a place must fit to; a camera that is so noisy that two pictures in a row do not may fit less.
    """

    def __init__(self, recording: TaughtStream, reach_px: int, least_fit: float) -> None:
        self._pictures, self._clear = recording.pictures, recording.clear
        self._stations_m = recording.stations_m[recording.picture_rows, 1]
        self._reach_px = reach_px
        self._least_fit = _attainable(recording.fits, least_fit)
        self._stretch: deque[_Kept] = deque(maxlen=_STRETCH)
        self.restart()

    def restart(self) -> None:
        """Forget what was seen."""
        self._stretch.clear()
        self._is_still = False
        self._doubt: str | None = None
        self._judged_m: float | None = None  # the station that was judged; None: none since the last picture

    def add(self, look: Look) -> None:
        """Take the newer picture of a look, if it was taken far enough from the last one."""
        travelled_m = look.travelled_m[1]
        if self._stretch:
            last = self._stretch[-1]
            if abs(travelled_m - last.travelled_m) < _STEP_M - _ROUNDING_M:
                return
            self._is_still = _correlation(last.small, look.small) > _SAME_PICTURE
            if self._is_still:
                self._stretch.clear()
        self._stretch.append(_Kept(look.small, look.clear, travelled_m))
        self._judged_m = None

    def doubt(self, station_m: float, direction: int) -> str | None:
        """Return a reason why the robot is not at a station; None where nothing contradicts it.

        Parameters
        ----------
        station_m : float
            Where it seems to be [m].
        direction : int
            1 when driving along the path, -1 when driving back.
        """
        if self._judged_m is None or abs(station_m - self._judged_m) > _STEP_M:
            self._doubt, self._judged_m = self._reason_against(station_m, direction), station_m
        return self._doubt

    def fit(self, station_m: float, direction: int) -> float | None:
        """Return how well the areas of the stretch fit, were its end at a station; None where there are few."""
        fits = np.concatenate([self._picture_fits(kept, station_m, direction) for kept in self._stretch])
        return float(fits.mean()) if len(fits) >= _LEAST_AREAS else None

    def _reason_against(self, station_m: float, direction: int) -> str | None:
        if self._is_still:
            return "the pictures do not change while the robot drives"
        if len(self._stretch) < _STRETCH:
            return "searching the place on the path"
        fit = self.fit(station_m, direction)
        if fit is None:
            return "too little to be seen to tell one place from another"
        if fit < self._least_fit:
            asked = f"{fit:.2f} only, not {self._least_fit:.2f}"
            return f"the most alike of the taught places fits to {asked}: it may be another"
        stations_m = (station_m + apart_m for apart_m in _RIVALS_M)
        rivals = [self.fit(one_m, direction) or 0.0 for one_m in stations_m if self._is_taught(one_m)]
        if max(rivals, default=0.0) > fit - _LEAST_MARGIN:
            return "places before or behind fit as well"
        return None

    def _is_taught(self, station_m: float) -> bool:
        return bool(self._stations_m[0] <= station_m <= self._stations_m[-1])

    def _picture_fits(self, kept: _Kept, station_m: float, direction: int) -> Floats:
        """Return the fit of every area of a picture of the stretch."""
        way_m = self._stretch[-1].travelled_m - kept.travelled_m
        expected = int(np.argmin(np.abs(self._stations_m - (station_m - direction * way_m))))
        near = range(max(0, expected - _NEAR_ROWS), min(len(self._pictures), expected + _NEAR_ROWS + 1))
        scores = np.array([self._shift_scores(row, kept.small) for row in near])
        best, top = np.unravel_index(int(np.argmax(scores)), scores.shape)
        row = near[int(best)]
        around = range(max(0, row - 1), min(len(self._pictures), row + 2))
        shift_px = int(top) - scores.shape[1] // 2
        taught = [self._pictures[k] for k in around]
        return area_fits(taught, self._clear[row], kept.small, kept.clear, shift_px)

    def _shift_scores(self, row: int, small: Float32s) -> Floats:
        scores = patch_scores(self._pictures[row], small)
        middle = len(scores) // 2
        return scores[middle - self._reach_px : middle + self._reach_px + 1]


def _correlation(one: Float32s, other: Float32s) -> float:
    a, b = one.ravel() - one.mean(), other.ravel() - other.mean()
    length = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / length if length > 0.0 else 1.0


def _attainable(fits: Floats, least_fit: float) -> float:
    """Return what a place must fit to, in view of what the camera's noise leaves of a fit."""
    known = fits[np.isfinite(fits)]
    if not len(known):
        return least_fit
    return min(least_fit, max(_LOWEST_FIT, _SHARE_OF_NOISE * float(np.median(known))))
