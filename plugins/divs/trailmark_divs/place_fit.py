"""Whether a place that looks the most alike is the place: how well its areas fit, over a stretch of the way.

One taught place is always the most alike, also to a robot that stands in another street or on another floor. What
tells them apart are areas: at the same place nearly all of them are found again where they belong; in another corridor
of the same plan the lamps and windows are, the posters are not. An area is compared by its patch-normalised pixels, and
may lie a few of them aside, for the robot drives beside its path. What is over-exposed shows the light, not the place.
Areas count by what they are worth to tell the place (`AreaWorth`), and as a share of what can be asked of them there.
Other light and people spoil the areas that they fall on and leave the rest as it was; another place leaves hardly any
as it was. So a mean that is somewhat low is made up for by better areas that fit very well.
A metre of another place may fit as well, where nothing is in view that tells the two apart; what was seen since the
search began does not. So all its pictures count together, and the less their areas are worth, the better they must fit.
Pictures from before the path begins cannot be compared: then as many are asked on the path. A way that is driven again,
or lies beside the path, makes the areas worth no more.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from trailmark.arrays import Bools, Float32s, Floats
from trailmark.patches import patch_scores
from trailmark_divs.area_fits import area_grid
from trailmark_divs.area_worth import AreaWorth
from trailmark_divs.eye import Look
from trailmark_divs.taught_stream import TaughtStream

__all__ = ["PlaceFit"]

_LEAST_WEIGHT = 10.0  # of all areas of a stretch
#: The better areas: what all fit to, read at these shares of their weight, from the worst on.
_READ_AT = (0.65, 0.7, 0.75)
#: A place is told, too, where the better areas fit to so much more than is asked of the mean, and the mean to so much
#: of it. Three tenths of a wall may be the same in two places: the mean must not be far too low.
_BETTER, _LEAST_MEAN = 1.06, 0.935
#: A stretch of little weight is told, too, where most areas fit to `_WELL`: the fit, less half of the share of those
#: that do not, may be so much below `place_fit` (in 160 starts in twins it was by 0.34 or more), and the mean so much.
_WELL, _OF_WELL, _MEAN_OF_WELL = 0.9, 0.242, 0.025
#: Pictures of a stretch at the fewest and at the most, and the way between two of them [m].
_FEWEST, _MOST, _STEP_M = 8, 32, 0.1
#: What a place must fit to holds for areas of so much weight; of twice as much, so much less is asked.
_WEIGHT, _LESS_OF_TWICE = 100.0, 0.016
_NEAR_ROWS = 2  # wheels and the odometry of teaching differ
#: So much less must places fit that lie so far before and behind.
_RIVALS_M, _LEAST_MARGIN = (-1.6, -1.2, 1.2, 1.6), 0.02
_SAME_PICTURE = 0.98  # correlation of two pictures of which one is not new
_ROUNDING_M = 1e-6
_SEARCHING = "searching the place on the path"
#: Comparisons that a frame may take, in pictures compared by areas (about 2 ms each); the next frame goes on with it.
_FRAME_WORK, _WORK_OF_PICTURE, _WORK_OF_WORTH = 32, 2, 4


@dataclass(frozen=True, slots=True, eq=False)
class _Kept:
    """A picture of the stretch: small, which of its pixels count, and what is known of it.

    `along_m` says how far along the path it was taken, from where the search began: ways back count against it [m].
    `fits` has, by row of the taught pictures, what the areas fit to there, and their weights.
    """

    small: Float32s
    clear: Bools
    along_m: float
    fits: dict[int, tuple[Floats, Floats]] = field(default_factory=dict)


class PlaceFit:
    """Compares the pictures since the search began with what was taught about a place, area by area.

    Parameters
    ----------
    recording : TaughtStream
        What was taught.
    reach_px : int
        Largest shift between a seen and a taught small picture [px].
    least_fit : float
        What a place must fit to, as a share of what can be asked of its areas, where they are worth a hundred.
    """

    def __init__(self, recording: TaughtStream, reach_px: int, least_fit: float) -> None:
        self._pictures, self._clear = recording.pictures, recording.clear
        self._stations_m = recording.stations_m[recording.picture_rows, 1]
        self._reach_px = reach_px
        self._worth = AreaWorth(recording.pictures, recording.clear, self._stations_m)
        self._least_fit = least_fit
        self._stretch: deque[_Kept] = deque(maxlen=_MOST)
        self._work_left = 0
        self.restart()

    def restart(self) -> None:
        """Forget what was seen."""
        self._stretch.clear()
        self._along_m = 0.0
        self._travelled_m: float | None = None
        self._is_still = False
        self._doubt: str | None = None
        self._judged_m: float | None = None  # the station that was judged; None: none since the last picture

    def add(self, look: Look, direction: int) -> None:
        """Take the newer picture of a look, if it was taken far enough from the last one.

        Parameters
        ----------
        look : Look
            The present one.
        direction : int
            1 when driving along the path, -1 when driving back.
        """
        travelled_m = look.travelled_m[1]
        self._along_m += direction * (0.0 if self._travelled_m is None else travelled_m - self._travelled_m)
        self._travelled_m = travelled_m
        if self._stretch:
            last = self._stretch[-1]
            if abs(self._along_m - last.along_m) < _STEP_M - _ROUNDING_M:
                return
            self._is_still = _correlation(last.small, look.small) > _SAME_PICTURE
            if self._is_still:
                self._stretch.clear()
        self._stretch.append(_Kept(look.small, look.clear, self._along_m))
        self._judged_m = None

    def doubt(self, station_m: float) -> str | None:
        """Return a reason why the robot is not at a station; None where nothing contradicts it.

        It compares no more than a frame has time for: until all is compared, the place is being searched.

        Parameters
        ----------
        station_m : float
            Where it seems to be [m].
        """
        if self._judged_m is None or abs(station_m - self._judged_m) > _STEP_M:
            self._work_left = _FRAME_WORK
            self._doubt = self._reason_against(station_m)
            self._judged_m = None if self._doubt == _SEARCHING else station_m
        return self._doubt

    def _area_fits(self, stretch: Sequence[_Kept], station_m: float) -> tuple[Floats, Floats]:
        """Return the fits of all areas of some pictures, were the last one at a station, and their weights."""
        found = [kept.fits[self._compared_row(kept, station_m)] for kept in stretch]
        return np.concatenate([fits for fits, _ in found]), np.concatenate([weights for _, weights in found])

    def _reason_against(self, station_m: float) -> str | None:
        if self._is_still:
            return "the pictures do not change while the robot drives"
        stretch = self._on_path(station_m)
        if not stretch or not self._compare_at(stretch, station_m):
            return _SEARCHING
        reason = self._reason_against_fit(*self._area_fits(stretch, station_m), self._share_of(stretch))
        if reason is None:
            latest = stretch[-_FEWEST:]
            rivals_m = [station_m + apart_m for apart_m in _RIVALS_M if self._is_taught(station_m + apart_m)]
            if not all(self._compare_at(latest, one_m) for one_m in rivals_m):
                return _SEARCHING
            fit, *rivals = (_mean(*self._area_fits(latest, one_m)) for one_m in (station_m, *rivals_m))
            if max(rivals, default=0.0) > fit - _LEAST_MARGIN:
                reason = "places before or behind fit as well"
        # Before there are enough pictures the comparisons are made already: then few are left to the last frame.
        return _SEARCHING if len(stretch) < max(_FEWEST, len(self._stretch) / 2) else reason

    def _reason_against_fit(self, fits: Floats, weights: Floats, share: float) -> str | None:
        weight = share * float(weights.sum())
        if weight < _LEAST_WEIGHT:
            return "too little to be seen to tell one place from another"
        fit, asked = _robust(fits, weights), self._least_fit - _LESS_OF_TWICE * math.log2(weight / _WEIGHT)
        if fit < asked and not self._fits_well(fits, weights, fit):
            return f"the most alike of the taught places fits to {fit:.2f} only, not {asked:.2f}: it may be another"
        return None

    def _fits_well(self, fits: Floats, weights: Floats, fit: float) -> bool:
        """Return whether so many areas fit so well that no more is asked, however little was seen."""
        poor = float(weights[fits < _WELL].sum() / weights.sum())
        is_mean_high = _mean(fits, weights) >= self._least_fit - _MEAN_OF_WELL
        return is_mean_high and fit - poor / 2.0 >= self._least_fit - _OF_WELL

    def _on_path(self, station_m: float) -> list[_Kept]:
        """Return the pictures that were taken where something was taught, were the last one at a station."""
        first, last = self._stations_m[0] - _STEP_M, self._stations_m[-1] + _STEP_M
        return [kept for kept in self._stretch if first <= self._station_of(kept, station_m) <= last]

    def _station_of(self, kept: _Kept, station_m: float) -> float:
        """Return where a picture was taken, were the last one at a station [m]."""
        return station_m - (self._stretch[-1].along_m - kept.along_m)

    def _share_of(self, stretch: Sequence[_Kept]) -> float:
        """Return what part of the way that was seen the path shows: not what lies beside it, nor the same way again."""
        seen_m = float(np.abs(np.diff([kept.along_m for kept in self._stretch])).sum())
        on_path_m = float(np.ptp([kept.along_m for kept in stretch]))
        return (on_path_m + _STEP_M) / (seen_m + _STEP_M)

    def _is_taught(self, station_m: float) -> bool:
        return bool(self._stations_m[0] <= station_m <= self._stations_m[-1])

    def _compare_at(self, stretch: Sequence[_Kept], station_m: float) -> bool:
        """Compare some pictures, were the last one at a station; False where this frame has no time left."""
        for kept in stretch:
            row = self._compared_row(kept, station_m)
            if row in kept.fits:
                continue
            if self._work_left <= 0:
                return False
            n_known = len(self._worth)
            kept.fits[row] = self._compare(kept, row)
            self._work_left -= _WORK_OF_PICTURE + _WORK_OF_WORTH * (len(self._worth) - n_known)
        return True

    def _compared_row(self, kept: _Kept, station_m: float) -> int:
        """Return the taught picture that a picture of the stretch belongs to, or the next one if that was compared."""
        row = int(np.argmin(np.abs(self._stations_m - self._station_of(kept, station_m))))
        return next((near for near in (row, row - 1, row + 1) if near in kept.fits), row)

    def _compare(self, kept: _Kept, expected: int) -> tuple[Floats, Floats]:
        near = range(max(0, expected - _NEAR_ROWS), min(len(self._pictures), expected + _NEAR_ROWS + 1))
        scores = np.array([self._shift_scores(row, kept.small) for row in near])
        best, top = np.unravel_index(int(np.argmax(scores)), scores.shape)
        row = near[int(best)]
        around = range(max(0, row - 1), min(len(self._pictures), row + 2))
        shift_px = int(top) - scores.shape[1] // 2
        taught = [self._pictures[k] for k in around]
        grid = area_grid(taught, self._clear[row], kept.small, kept.clear, shift_px)
        return self._worth.weighed(row, grid, shift_px)

    def _shift_scores(self, row: int, small: Float32s) -> Floats:
        scores = patch_scores(self._pictures[row], small)
        middle = len(scores) // 2
        return scores[middle - self._reach_px : middle + self._reach_px + 1]


def _mean(fits: Floats, weights: Floats) -> float:
    return float(np.minimum(fits, 1.0) @ weights / weights.sum()) if len(weights) else 0.0


def _robust(fits: Floats, weights: Floats) -> float:
    """Return the mean fit, or what it would be by the better areas, as far as it is not much lower itself."""
    order = np.argsort(fits)
    share = np.cumsum(weights[order])
    better = fits[order][np.searchsorted(share, np.array(_READ_AT) * share[-1])].mean()
    mean = _mean(fits, weights)
    return max(mean, min(float(better) / _BETTER, mean / _LEAST_MEAN))


def _correlation(one: Float32s, other: Float32s) -> float:
    a, b = one.ravel() - one.mean(), other.ravel() - other.mean()
    length = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / length if length > 0.0 else 1.0
