"""Single pictures compared by their brightness profiles, for where the stream is blind."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from trailmark.estimates import Belief
from trailmark_divs.eye import Look
from trailmark_divs.options import Correspond
from trailmark_divs.robust_shift import local_windows, shift_scores, summit
from trailmark_divs.taught_stream import TaughtStream
from trailmark_divs.tracking import REACH, ShiftTracker, TrackedShift

__all__ = ["Glances", "PathPlace"]


@dataclass(frozen=True, slots=True)
class PathPlace:
    """Where on the taught path a picture belongs.

    Attributes
    ----------
    row : int
        The taught picture before it.
    fraction : float
        How far it lies towards the next one.
    station_m, heading_rad : float
        Taught station and heading there [m, rad].
    """

    row: int
    fraction: float
    station_m: float
    heading_rad: float


class Glances:
    """Compares a picture with the two taught ones before and after its place.

    In a bend the shifts to the two differ by what the path turns between them, so the shift is interpolated.

    Parameters
    ----------
    recording : TaughtStream
        The taught path.
    by : {"distance", "time", "index", "appearance"}
        What says the place; by appearance, which takes whole windows, it is the belief's station.
    usable : (d,) bool
        Columns that may be compared.
    correlation_window, max_shift : int
        As in the config.
    """

    def __init__(
        self,
        recording: TaughtStream,
        by: Correspond,
        usable: npt.NDArray[np.bool_],
        correlation_window: int,
        max_shift: int,
    ) -> None:
        self._recording = recording
        self._by = by
        self._usable = usable
        self._correlation_window = correlation_window
        self._max_shift = max_shift
        self._stations_m = recording.stations_m[:, 1]
        self._labels = {
            "time": recording.stamps_s[:, 1] - recording.stamps_s[0, 0],
            "index": np.arange(len(recording), dtype=np.float64),
        }.get(by, self._stations_m)

    def place(self, look: Look, start_s: float, belief: Belief) -> PathPlace | None:
        """Return where the newer picture of a look belongs; None where that is not known or nothing was taught."""
        label, labels = self._label(look, start_s, belief), self._labels
        if label is None or len(labels) < 2 or not labels[0] <= label <= labels[-1]:
            return None
        row = min(max(0, int(np.searchsorted(labels, label)) - 1), len(labels) - 2)
        gap = float(labels[row + 1] - labels[row])
        fraction = (label - float(labels[row])) / gap if gap > 0.0 else 0.0
        station_m, heading_rad = (
            float((1.0 - fraction) * values[row] + fraction * values[row + 1])
            for values in (self._stations_m, self._recording.headings_rad)
        )
        return PathPlace(row, fraction, station_m, heading_rad)

    def at(self, row: int) -> PathPlace:
        """Return the place of a taught look."""
        return PathPlace(row, 0.0, float(self._stations_m[row]), float(self._recording.headings_rad[row]))

    def shift(self, look: Look, place: PathPlace, tracker: ShiftTracker) -> TrackedShift:
        """Return the shift of the newer picture of a look."""
        seen = self._windows(look.profile)
        before, after = (
            shift_scores(self._windows(self._recording.profiles[row]), seen, self._max_shift)
            for row in (place.row, place.row + 1)
        )
        tracked = tracker.update((1.0 - place.fraction) * before + place.fraction * after)
        near = round(tracked.columns) + self._max_shift
        index = (1.0 - place.fraction) * summit(before, near, REACH) + place.fraction * summit(after, near, REACH)
        return replace(tracked, columns=index - self._max_shift)

    def _label(self, look: Look, start_s: float, belief: Belief) -> float | None:
        if self._by == "time":
            return look.stamps_s[1] - start_s
        if self._by == "index":
            return float(look.ordinal)
        return None if belief.on_path is None else belief.on_path.station_m

    def _windows(self, profile: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return local_windows(profile, self._usable, self._correlation_window)
