"""The features of a taught path: change vectors over windows of looks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats, Int64s
from trailmark_divs.averaging import mean_windows, trimmed_windows
from trailmark_divs.eye import TURNING
from trailmark_divs.taught_stream import TaughtStream

__all__ = ["Windows"]


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """The change vectors of a taught path: every full window that no turn interrupts.

    Attributes
    ----------
    vectors : (M, d) float64
        Change vectors.
    stations_m, elapsed_s, headings_rad : (M,) float64
        Place, time since the start, and heading of each window's middle [m, s, rad].
    ordinals : (M,) int64
        Index of each window's newest look in the recording.
    """

    vectors: Floats
    stations_m: Floats
    elapsed_s: Floats
    headings_rad: Floats
    ordinals: Int64s

    def __len__(self) -> int:
        return len(self.ordinals)

    @classmethod
    def of(cls, recording: TaughtStream, window: int, n_trimmed: int, scale: Floats) -> Windows:
        """Average a recording over windows, Eq. (6); see `ColumnLayout.scale` for `scale`."""
        runs = recording.runs
        newest = np.arange(window - 1, len(runs))
        oldest = newest - window + 1
        is_whole = (runs[newest] == runs[oldest]) & (runs[newest] != TURNING)  # runs only count up
        if not len(newest):
            nothing = np.empty(0)
            return cls(np.empty((0, len(scale))), nothing, nothing, nothing, np.empty(0, dtype=np.int64))
        averages = trimmed_windows(recording.sums, window, n_trimmed) if n_trimmed else None
        vectors = mean_windows(recording.sums, window) if averages is None else averages
        stations_m = _means(recording.stations_m.mean(axis=1), window)
        elapsed_s = _means(recording.stamps_s.mean(axis=1), window) - recording.stamps_s[0, 0]
        before = np.concatenate([recording.headings_rad[:1], recording.headings_rad[:-1]])
        headings_rad = _means((before + recording.headings_rad) / 2.0, window)
        return cls(
            vectors[is_whole] * scale,
            stations_m[is_whole],
            elapsed_s[is_whole],
            headings_rad[is_whole],
            newest[is_whole],
        )


def _means(values: Floats, window: int) -> Floats:
    first = values[0]  # sums of stamps since 1970 would lose digits
    sums = np.concatenate([[0.0], np.cumsum(values - first)])
    return np.asarray(first + (sums[window:] - sums[:-window]) / window)
