"""How probable it is that one method beats another: over seeds, places and conditions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from trailmark.arrays import Floats
from trailmark_bench.entries import MethodResult, MethodResults
from trailmark_bench.quantities import Metric
from trailmark_bench.statistics import RESAMPLES

__all__ = ["Improvement", "improvements"]

_FEWEST = 3


@dataclass(frozen=True, slots=True)
class Improvement:
    """How probable it is that a method is better than another on frames that both have seen.

    After Agarwal et al. 2021 (Deep reinforcement learning at the edge of the statistical precipice): the share of pairs
    in which it is better, a tie counting half, averaged over conditions. Differs from the paper: pairs are those of
    equal place and seed, because both methods see the same frames there; seeds are averaged within a place, places
    within a condition.

    Attributes
    ----------
    method, other : str
        In words.
    probability : float
        That `method` is better than `other`; two failures are a tie.
    low, high : float or None
        95 % interval by the percentile bootstrap over conditions; None below three.
    n_conditions : int
        Conditions that both have run under.
    """

    method: str
    other: str
    probability: float
    low: float | None
    high: float | None
    n_conditions: int


def improvements(methods: Sequence[str], results: MethodResults, metric: Metric) -> list[Improvement]:
    """Return an `Improvement` for each ordered pair of methods that have a condition in common."""
    conditions = dict.fromkeys(result.condition for result in results.values())
    found = []
    for first, second in combinations(methods, 2):
        pairs = [(results.get((first, name)), results.get((second, name))) for name in conditions]
        known = [_share(one, other, metric) for one, other in pairs if one is not None and other is not None]
        shares = np.array([share for share in known if share is not None])
        if len(shares):
            found += [_improvement((first, second), shares), _improvement((second, first), 1.0 - shares)]
    return found


def _improvement(names: tuple[str, str], shares: Floats) -> Improvement:
    low, high = (None, None) if len(shares) < _FEWEST else _interval(shares)
    return Improvement(*names, float(shares.mean()), low, high, len(shares))


def _interval(shares: Floats) -> tuple[float, float]:
    draws = np.random.default_rng(20150101).integers(0, len(shares), (RESAMPLES, len(shares)))
    low, high = np.quantile(shares[draws].mean(axis=1), [0.025, 0.975]).tolist()
    return low, high


def _share(one: MethodResult, other: MethodResult, metric: Metric) -> float | None:
    """Return the share of equal trials in which the one is better, each place counting once; None without any."""
    ours, theirs = one.values[metric.name], other.values[metric.name]
    places: dict[str, list[float]] = {}
    for trial in ours.keys() & theirs.keys():
        mine, its = metric.oriented(ours[trial]), metric.oriented(theirs[trial])
        places.setdefault(trial[0], []).append(0.5 if mine == its else float(mine < its))
    return float(np.mean([np.mean(found) for found in places.values()])) if places else None
