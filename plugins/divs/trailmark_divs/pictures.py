"""Small pictures compared with the taught ones: in bends, before a window is full, and wherever they are the surer."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Belief
from trailmark.patches import SMALL_PX, patch_scores, peak
from trailmark_divs.eye import Look
from trailmark_divs.glance import Glances, PathPlace
from trailmark_divs.taught_stream import TaughtStream
from trailmark_divs.tracking import TrackedShift

__all__ = ["PictureShift", "PictureShifts", "peak_confidence", "peak_sigmas", "shift_sigma_columns"]

_NEAR_PX = 4  # of the peak: belongs to it
#: How far a peak stands out from the other shifts, in their standard deviations, when it is as often false as right,
#: and how fast that changes. The highest of sixty unrelated scores stands out by about 2.3.
_EVEN, _PER_SIGMA = 2.5, 1.6
#: Standard deviation of a shift whose peak is a correlation of 1 [columns]; it grows with the inverse square, as on
#: simulated places (numbers 11 and 12 of `benchmarks/divs_winding.py`); and the least that is claimed.
_SIGMA_COLUMNS, _LEAST_SIGMA_COLUMNS, _LEAST_SCORE = 0.05, 0.1, 0.1


@dataclass(frozen=True, slots=True)
class PictureShift:
    """A small picture that was compared with the taught ones.

    Attributes
    ----------
    place : PathPlace
        Where.
    shift : TrackedShift
        With what result.
    sigma_columns : float
        Standard deviation of the shift, if it is the right peak [columns].
    """

    place: PathPlace
    shift: TrackedShift
    sigma_columns: float


@dataclass(frozen=True, slots=True, eq=False)
class _Neighbours:
    """The two taught pictures between which a place lies, and its share of the way to the second."""

    before: int
    after: int
    fraction: float


class PictureShifts:
    """Finds the shift of a small picture against the two taught ones about its place.

    Parameters
    ----------
    recording : TaughtStream
        What was taught.
    glances : Glances
        Knows the place of a look.
    columns_per_width : float
        Columns of the stream in the width of a picture.
    radians_per_column : float
        Angle of a column [rad].
    max_shift_columns : int
        Largest shift [columns].
    """

    def __init__(
        self,
        recording: TaughtStream,
        glances: Glances,
        *,
        columns_per_width: float,
        radians_per_column: float,
        max_shift_columns: int,
    ) -> None:
        self._pictures = recording.pictures
        self._rows = recording.picture_rows
        self._glances = glances
        self._columns_per_px = columns_per_width / SMALL_PX[0]
        self._radians_per_px = radians_per_column * self._columns_per_px
        self._headings_rad = recording.headings_rad
        self._are_turns_taught = bool(len(recording)) and float(np.ptp(recording.headings_rad)) > 0.0
        self._reach_px = min(SMALL_PX[0] // 2, max(1, round(max_shift_columns / self._columns_per_px)))

    def __len__(self) -> int:
        return len(self._pictures)

    @property
    def reach_px(self) -> int:
        """Largest shift that is looked for, in pixels of the small pictures."""
        return self._reach_px

    def at_present(self, look: Look, start_s: float, belief: Belief) -> PictureShift | None:
        """Compare where the belief says that the picture belongs; None where it does not, or nothing was taught."""
        place = self._glances.place(look, start_s, belief) if len(self) else None
        return None if place is None else self._compare_newer(look, place)

    def at_row(self, look: Look, row: int) -> PictureShift:
        """Compare with what was taught about a row of the looks."""
        return self._compare_newer(look, self._glances.at(row))

    def _compare_newer(self, look: Look, place: PathPlace) -> PictureShift:
        """Return the shift of the newer picture of a look at a place, and how probably it is right."""
        near = self._neighbours(place.row + place.fraction)
        scores = [self._scores(row, look, place) for row in (near.before, near.after)]
        blended = (1.0 - near.fraction) * scores[0] + near.fraction * scores[1]
        top = int(np.argmax(blended))
        first, last = max(0, top - 2 * _NEAR_PX), top + 2 * _NEAR_PX + 1
        shift_px = _peak_within(blended, first, last)
        shifts = [_peak_within(one, first, last) for one in scores]
        # A turn between the two that nothing measured: each has its own peak near by, or else shows something else.
        if not self._are_turns_taught and abs(shifts[0] - shifts[1]) <= 2 * _NEAR_PX:
            shift_px = (1.0 - near.fraction) * shifts[0] + near.fraction * shifts[1]
        standing_out = peak_sigmas(scores[0] if near.fraction < 0.5 else scores[1])
        confidence = peak_confidence(standing_out)
        score = float(blended[top])
        shift = TrackedShift(shift_px * self._columns_per_px, confidence=confidence, margin=standing_out, score=score)
        return PictureShift(place, shift, shift_sigma_columns(score))

    def _scores(self, row: int, look: Look, place: PathPlace) -> Floats:
        """Return the scores of a taught picture as they would be, had it been taught with the heading of the place."""
        scores = patch_scores(self._pictures[row], look.small)
        turned_px = float(self._headings_rad[self._rows[row]] - place.heading_rad) / self._radians_per_px
        if turned_px:
            at = np.arange(len(scores), dtype=np.float64)
            scores = np.interp(at, at + turned_px, scores)
        middle = len(scores) // 2
        return scores[middle - self._reach_px : middle + self._reach_px + 1]

    def _neighbours(self, at_look: float) -> _Neighbours:
        after = int(np.searchsorted(self._rows, at_look))
        after = min(max(after, 1), len(self._rows) - 1) if len(self._rows) > 1 else 0
        before = max(after - 1, 0)
        gap = float(self._rows[after] - self._rows[before])
        fraction = (at_look - float(self._rows[before])) / gap if gap > 0.0 else 0.0
        return _Neighbours(before, after, min(1.0, max(0.0, fraction)))


def peak_sigmas(scores: Floats) -> float:
    """Return how far the highest score stands out from those of other shifts, in their standard deviations."""
    top = int(np.argmax(scores))
    others = np.concatenate([scores[: max(0, top - _NEAR_PX)], scores[top + _NEAR_PX + 1 :]])
    if len(others) < 2 * _NEAR_PX:
        return 0.0
    return float((scores[top] - others.mean()) / max(float(others.std()), 1e-6))


def peak_confidence(sigmas: float) -> float:
    """Return the probability that a peak is the right one, by how far it stands out."""
    return 1.0 / (1.0 + math.exp(-_PER_SIGMA * (sigmas - _EVEN)))


def shift_sigma_columns(score: float) -> float:
    """Return how uncertain a shift is whose peak is as high as this correlation, one standard deviation [columns]."""
    return max(_LEAST_SIGMA_COLUMNS, _SIGMA_COLUMNS / max(score, _LEAST_SCORE) ** 2)


def _peak_within(scores: Floats, first: int, last: int) -> float:
    """Return where scores peak within a range, as a shift from the middle of all [px]."""
    part = scores[first:last]
    shift, _ = peak(part)
    return shift + len(part) // 2 + first - len(scores) // 2
