"""What the plots draw: lines thinned without losing peaks, broken where nothing was known, and binned outcomes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from trailmark.arrays import Floats, Indices
from trailmark.evaluation import OUTCOMES, EstimateTable, Evaluation, RunEvaluation, absolute_errors
from trailmark.evaluation.association import usual_interval_s
from trailmark.geometry import Trajectory

__all__ = [
    "MAX_POINTS",
    "ErrorSeries",
    "Lane",
    "breaks",
    "error_series",
    "lanes",
    "position_errors",
    "thin_line",
    "way",
]


#: No line has more points.
MAX_POINTS = 2000

_GAP_INTERVALS = 3.0
# A line of a real recording, where every tenth interval is three times as long, would fall into crumbs.
_SEEN_SHARE = 0.003
_MAX_BINS = 240


@dataclass(frozen=True, slots=True, eq=False)
class ErrorSeries:
    """Errors of one trajectory over time, NaN in gaps.

    Attributes
    ----------
    time_s : (N,) float64
        Since the start of the run [s].
    position_m, heading_deg : (N,) float64
        Distance, and signed heading error.
    """

    time_s: Floats
    position_m: Floats
    heading_deg: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Lane:
    """What became of the estimates of one localizer over time.

    Attributes
    ----------
    name : str
        The localizer.
    edges_s : (M + 1,) float64
        Bins since the start of the run [s].
    shares : mapping of str to (M,) float64
        Share of each outcome among the estimates of a bin; all zero where there was none.
    counts : mapping of str to int
        Of the whole run.
    """

    name: str
    edges_s: Floats
    shares: Mapping[str, Floats]
    counts: Mapping[str, int]


def thin_line(values: Floats, limit: int = MAX_POINTS) -> Indices:
    """Return the indices of at most `limit` points that keep the first, the last, and every peak.

    Of each of ``limit / 2`` equal pieces the smallest and the largest value stay.

    Parameters
    ----------
    values : (N,) float64
        What is drawn upwards; NaN counts as a value to keep.
    """
    if len(values) <= limit:
        return np.arange(len(values))
    edges = np.linspace(0, len(values), limit // 2).astype(np.intp)
    kept = [np.array([0, len(values) - 1], dtype=np.intp)]
    for start, stop in pairwise(edges):
        piece = values[start:stop]
        kept.append(start + np.array([np.argmin(piece), np.argmax(piece)], dtype=np.intp))  # both find a NaN first
    return np.unique(np.concatenate(kept))


def way(trajectory: Trajectory) -> Floats:
    """Return the positions to draw, (N, 2), with a row of NaN where the trajectory has a gap."""
    step = max(1, -(-len(trajectory) // (MAX_POINTS // 2)))
    last = np.arange(len(trajectory))[-1:]
    kept = np.union1d(np.arange(0, len(trajectory), step), last)
    cuts = np.searchsorted(kept, breaks(trajectory.stamps_s))
    return np.insert(trajectory.positions[kept], cuts, np.nan, axis=0)


def error_series(evaluated: RunEvaluation) -> dict[str, ErrorSeries]:
    """Return the errors (or differences) over time of every trajectory that could be compared."""
    span = evaluated.run.span_s()
    start_s = span[0] if span else 0.0
    return {name: _series(evaluation, start_s) for name, evaluation in evaluated.evaluations.items()}


def position_errors(evaluated: RunEvaluation) -> dict[str, Floats]:
    """Return the distances from the reference of every trajectory that could be compared, (N,) each [m]."""
    return {
        name: absolute_errors(evaluation.pairs, evaluation.absolute.alignment)[0]
        for name, evaluation in evaluated.evaluations.items()
    }


def lanes(estimates: EstimateTable, names: Iterable[str]) -> list[Lane]:
    """Return what became of the estimates of each localizer, in bins of time that hold at least two of them."""
    stamps = estimates.stamp_s[np.isfinite(estimates.stamp_s)]
    if len(stamps) == 0:
        return []
    span_s = float(stamps.min()), float(stamps.max())
    return [_lane(name, estimates.of(name), span_s) for name in names]


def _series(evaluation: Evaluation, start_s: float) -> ErrorSeries:
    distances, turns = absolute_errors(evaluation.pairs, evaluation.absolute.alignment)
    stamps = evaluation.pairs.estimate.stamps_s
    kept = np.union1d(thin_line(distances, MAX_POINTS // 2), thin_line(turns, MAX_POINTS // 2))
    kept = kept[thin_line(distances[kept])]  # both peaks where there is room, those of the distance first
    cuts = np.searchsorted(kept, breaks(stamps))
    columns = (stamps[kept] - start_s, distances[kept], np.degrees(turns[kept]))
    return ErrorSeries(*(np.insert(column, cuts, np.nan) for column in columns))


def breaks(stamps_s: Floats) -> Indices:
    """Return the indices before which there is a gap: several usual intervals, and wide enough to be seen."""
    if len(stamps_s) < 2:
        return np.zeros(0, dtype=np.intp)
    least_s = max(_GAP_INTERVALS * usual_interval_s(stamps_s), _SEEN_SHARE * float(stamps_s[-1] - stamps_s[0]))
    return np.flatnonzero(np.diff(stamps_s) > least_s) + 1


def _lane(name: str, estimates: EstimateTable, span_s: tuple[float, float]) -> Lane:
    edges_s = _bins(estimates.stamp_s, *span_s)
    counted = {
        outcome: np.histogram(estimates.stamp_s[estimates.outcome == outcome], edges_s)[0].astype(np.float64)
        for outcome in OUTCOMES
    }
    total = np.maximum(sum(counted.values()), 1.0)
    shares = {outcome: counts / total for outcome, counts in counted.items()}
    return Lane(name, edges_s - span_s[0], shares, estimates.counts())


def _bins(stamps_s: Floats, first_s: float, last_s: float) -> Floats:
    different_s = np.unique(stamps_s)
    usual_s = usual_interval_s(different_s) if len(different_s) > 1 else 0.0
    width_s = max((last_s - first_s) / _MAX_BINS, 2.0 * usual_s, 1e-3)
    return np.linspace(first_s, max(last_s, first_s + width_s), max(1, round((last_s - first_s) / width_s)) + 1)
