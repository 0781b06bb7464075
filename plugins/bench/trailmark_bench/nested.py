"""Statistics where places are drawn, and seeds within each: the seeds of one place are no independent witnesses."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

import numpy as np

from trailmark.arrays import Floats
from trailmark_bench.statistics import (
    RESAMPLES,
    Comparison,
    SampleSpread,
    clip,
    compare_all,
    difference_of,
    ratio_of,
    signed_rank_p,
    spreads,
    unclip,
)

__all__ = ["Samples", "compare_samples", "spreads_of_samples"]

#: Oriented values by place.
Samples = Sequence[Sequence[float]]


def spreads_of_samples(rows: Sequence[Samples]) -> list[SampleSpread]:
    """Return the spread of each row of oriented values by place; infinity is a failure.

    Of one place: median, quartiles and interval over its seeds. Of several: those of the places' medians, each place
    counting once; the interval is a hierarchical bootstrap, which draws places, and then seeds within each that was
    drawn (Davison & Hinkley 1997, Sec. 3.8).
    """
    single = iter(spreads([row[0] for row in rows if len(row) == 1]))
    return [next(single) if len(row) == 1 else _nested_spread(row) for row in rows]


def _nested_spread(places: Samples) -> SampleSpread:
    medians = np.array([np.median(clip(place)) for place in places])
    q1, middle, q3 = (unclip(value) for value in np.quantile(medians, [0.25, 0.5, 0.75]).tolist())
    low, high = (None, None) if len(places) < 3 else _interval(places)
    return SampleSpread(sum(map(len, places)), middle, q1, q3, low, high, len(places))


def _interval(places: Samples) -> tuple[float, float]:
    """Return the 2.5 and 97.5 % quantiles of the statistic over resamples of places, and of seeds in them."""
    rng, n = np.random.default_rng(20150101), len(places)
    drawn = rng.integers(0, n, (RESAMPLES, n))
    medians = np.empty((RESAMPLES, n))
    for index, place in enumerate(places):
        is_drawn = drawn == index
        medians[is_drawn] = _resampled_medians(clip(place), int(is_drawn.sum()), rng)
    low, high = np.quantile(np.median(medians, axis=1), [0.025, 0.975]).tolist()
    return unclip(low), unclip(high)


def _resampled_medians(values: Floats, n: int, rng: np.random.Generator) -> Floats:
    draws = rng.integers(0, len(values), (n, len(values)))
    medians: Floats = np.median(values[draws], axis=1)
    return medians


def compare_samples(rows: Sequence[tuple[Samples, Samples]]) -> list[Comparison]:
    """Return the comparison of each (values, baseline), pair by pair within each place.

    Of several places each counts once: by the median of its differences.
    """
    single = iter(compare_all([(ours[0], theirs[0]) for ours, theirs in rows if len(ours) == 1]))
    return [next(single) if len(ours) == 1 else _nested_comparison(ours, theirs) for ours, theirs in rows]


def _nested_comparison(ours: Samples, theirs: Samples) -> Comparison:
    differences = [list(map(difference_of, *place)) for place in zip(ours, theirs, strict=True)]
    spread = _nested_spread(differences)
    ratios = [ratio_of(*place) for place in zip(ours, theirs, strict=True)]
    known = [ratio for ratio in ratios if ratio is not None]
    every = [value for place in differences for value in place]
    return Comparison(
        n=len(every),
        difference=spread.median,
        low=spread.low,
        high=spread.high,
        ratio=median(known) if len(known) == len(ratios) else None,
        wins=sum(value < 0.0 for value in every),
        losses=sum(value > 0.0 for value in every),
        p=signed_rank_p([median(place) for place in differences]),
    )
