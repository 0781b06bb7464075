"""Statistics over seeds and pairs that stay honest: a failure is the worst result, never a missing one.

Values are oriented first, so that lower is better; a cell that failed counts as infinitely bad. Medians, quartiles,
ranks and signed ranks then need no exception for it: a method cannot win by crashing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from statistics import median

import numpy as np

from trailmark.arrays import Floats, Indices

__all__ = [
    "RESAMPLES",
    "Comparison",
    "SampleSpread",
    "clip",
    "compare_all",
    "compare_pairs",
    "difference_of",
    "holm",
    "mean_ranks",
    "ratio_of",
    "signed_rank_p",
    "spreads",
    "unclip",
]

#: Resamples of a bootstrap interval.
RESAMPLES = 2000

# Stands for infinity where quantiles are interpolated: infinity minus infinity is no number.
_WORST = 1e300
_INFINITE = 1e200

# Exact up to here; beyond it the normal approximation is good to a thousandth.
_EXACT = 25


@dataclass(frozen=True, slots=True)
class SampleSpread:
    """Oriented values of one cell over seeds; infinite where failures decide.

    Attributes
    ----------
    n : int
        Values, failures included.
    median, q1, q3 : float
        Median and quartiles.
    low, high : float or None
        95 % interval of the median by the percentile bootstrap; None below 3 values.
    n_places : int
        Places that the values come from.
    """

    n: int
    median: float
    q1: float
    q3: float
    low: float | None
    high: float | None
    n_places: int = 1


@dataclass(frozen=True, slots=True)
class Comparison:
    """Paired differences of oriented values from a baseline: below zero is better.

    Attributes
    ----------
    n : int
        Pairs.
    difference : float
        Median difference; infinite where failures decide.
    low, high : float or None
        95 % interval of it.
    ratio : float or None
        Median of value over baseline; None where a value is not positive or failed.
    wins, losses : int
        Pairs that are better, or worse.
    p : float or None
        Two-sided, Wilcoxon's signed ranks; None without a pair that differs or below 2 pairs.
    """

    n: int
    difference: float
    low: float | None
    high: float | None
    ratio: float | None
    wins: int
    losses: int
    p: float | None


def spreads(rows: Sequence[Sequence[float]]) -> list[SampleSpread]:
    """Return the spread of each row of oriented values; infinity is a failure.

    Parameters
    ----------
    rows : sequence of sequence of float
        At least one value each.
    """
    found: list[SampleSpread | None] = [None] * len(rows)
    by_length: dict[int, list[int]] = {}
    for index, row in enumerate(rows):
        by_length.setdefault(len(row), []).append(index)
    for n, indices in by_length.items():
        table = np.sort(clip(np.array([rows[index] for index in indices])), axis=1)
        quartiles = np.quantile(table, [0.25, 0.5, 0.75], axis=1)
        bounds = _interval(table) if n >= 3 else None
        for place, index in enumerate(indices):
            q1, median, q3 = (unclip(value) for value in quartiles[:, place].tolist())
            low, high = (None, None) if bounds is None else (unclip(value) for value in bounds[:, place].tolist())
            found[index] = SampleSpread(n, median, q1, q3, low, high)
    return [spread for spread in found if spread is not None]


def _interval(sorted_rows: Floats) -> Floats:
    """Return the 2.5 and 97.5 % quantiles of the medians of resamples, (2, rows).

    A resample's median is the mean of two of the row's own order statistics; which two depends on the draw alone, so
    that one set of draws serves all rows.
    """
    below, above = _order_statistics(sorted_rows.shape[1])
    bounds = np.empty((2, len(sorted_rows)))
    for start in range(0, len(sorted_rows), 1024):
        piece = sorted_rows[start : start + 1024]
        medians = 0.5 * piece[:, below] + 0.5 * piece[:, above]
        bounds[:, start : start + 1024] = np.quantile(medians, [0.025, 0.975], axis=1)
    return bounds


@lru_cache(maxsize=64)
def _order_statistics(n: int) -> tuple[Indices, Indices]:
    draws = np.sort(np.random.default_rng(20150101).integers(0, n, (RESAMPLES, n)), axis=1)
    return draws[:, (n - 1) // 2], draws[:, n // 2]


def compare_pairs(values: Sequence[float], baseline: Sequence[float]) -> Comparison:
    """Compare oriented values with those of a baseline, pair by pair; infinity is a failure.

    Two failures are equal; one failure is the largest difference of all.
    """
    return compare_all([(values, baseline)])[0]


def compare_all(pairs: Sequence[tuple[Sequence[float], Sequence[float]]]) -> list[Comparison]:
    """Return `compare_pairs` of each (values, baseline)."""
    differences = [[difference_of(*both) for both in zip(*pair, strict=True)] for pair in pairs]
    return [
        _comparison(*pair, difference, spread)
        for pair, difference, spread in zip(pairs, differences, spreads(differences), strict=True)
    ]


def difference_of(ours: float, theirs: float) -> float:
    """Return how much an oriented value is above another; two failures are equal."""
    return 0.0 if math.isinf(ours) and math.isinf(theirs) else ours - theirs


def ratio_of(ours: Sequence[float], theirs: Sequence[float]) -> float | None:
    """Return the median ratio of pairs; None where a value is not positive or failed, and without any."""
    is_positive = all(0.0 < value < math.inf for value in (*ours, *theirs))
    return median(a / b for a, b in zip(ours, theirs, strict=True)) if is_positive and ours else None


def _comparison(
    ours: Sequence[float], theirs: Sequence[float], difference: Sequence[float], spread: SampleSpread
) -> Comparison:
    return Comparison(
        n=len(difference),
        difference=spread.median,
        low=spread.low,
        high=spread.high,
        ratio=ratio_of(ours, theirs),
        wins=sum(value < 0.0 for value in difference),
        losses=sum(value > 0.0 for value in difference),
        p=signed_rank_p(difference),
    )


def signed_rank_p(differences: Sequence[float]) -> float | None:
    """Return the two-sided p-value of Wilcoxon's signed-rank test that differences are symmetric about zero.

    Zeros are left out, ties share their ranks. Exact up to 25 differences, ties included; beyond that by the normal
    approximation with a correction for ties.

    Returns
    -------
    float or None
        None where fewer than two differ from zero.
    """
    values = [value for value in differences if value != 0.0]
    if len(values) < 2:
        return None
    ranks = _ranks([abs(value) for value in values])
    positive = sum(rank for rank, value in zip(ranks, values, strict=True) if value > 0)
    if len(values) <= _EXACT:
        doubled = tuple(sorted(round(2 * rank) for rank in ranks))
        return _exact_p(doubled, round(2 * positive))
    mean = sum(ranks) / 2.0
    deviation = math.sqrt(sum(rank * rank for rank in ranks) / 4.0)
    distance = max(abs(positive - mean) - 0.5, 0.0) / deviation
    return math.erfc(distance / math.sqrt(2.0))


@lru_cache(maxsize=4096)
def _exact_p(doubled: tuple[int, ...], statistic: int) -> float:
    """Return the share of the 2^n signs whose sum of positive ranks lies as far out as the statistic."""
    ways = np.zeros(sum(doubled) + 1)
    ways[0] = 1.0
    for rank in doubled:
        ways[rank:] = ways[rank:] + ways[: len(ways) - rank]
    share = ways / ways.sum()
    return float(min(1.0, 2.0 * min(share[: statistic + 1].sum(), share[statistic:].sum())))


def mean_ranks(rows: Sequence[Sequence[float]]) -> list[float]:
    """Return the mean rank of each column over the rows: 1 is best, ties and failures share."""
    table = np.array([_ranks(row) for row in rows])
    return [float(value) for value in table.mean(axis=0)]


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """Return p-values adjusted by Holm's method for as many tests as have one."""
    known = sorted((value, index) for index, value in enumerate(p_values) if value is not None)
    adjusted: list[float | None] = [None] * len(p_values)
    highest = 0.0
    for place, (value, index) in enumerate(known):
        highest = max(highest, min(1.0, (len(known) - place) * value))
        adjusted[index] = highest
    return adjusted


def _ranks(values: Sequence[float]) -> list[float]:
    """Return the rank of each value from 1; equal values share the mean of theirs."""
    _, place, counts = np.unique(values, return_inverse=True, return_counts=True)
    ranks = counts.cumsum() - (counts - 1) / 2.0
    return [float(rank) for rank in ranks[place]]


def clip(values: Sequence[float] | Floats) -> Floats:
    """Return values that can be interpolated: failures are very large numbers."""
    return np.clip(np.asarray(values, dtype=np.float64), -_WORST, _WORST)


def unclip(value: float) -> float:
    """Return what was interpolated, with infinity for failures."""
    return math.copysign(math.inf, value) if abs(value) > _INFINITE else value
