"""One method over all conditions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from trailmark_bench.cell import UNSUCCESSFUL
from trailmark_bench.entries import MethodResult, MethodResults
from trailmark_bench.quantities import Metric
from trailmark_bench.statistics import compare_pairs, mean_ranks

__all__ = ["Overall", "overall_of"]


@dataclass(frozen=True, slots=True)
class Overall:
    """One method over all conditions.

    Attributes
    ----------
    method : str
        In words.
    n_ok, n_failed, n_skipped, n_open : int
        Cells with a result, without one, that meant nothing, and that have not run.
    rank : float or None
        Mean rank by the first metric, among the methods of the same condition, place and seed; 1 is best.
    n_ranked : int
        Conditions, places and seeds behind it.
    ratio : float or None
        Median over conditions of the median ratio to the baseline.
    p : float or None
        Signed ranks of the conditions' median differences: seeds of one condition are no independent witnesses.
    n_conditions : int
        Conditions behind it.
    """

    method: str
    n_ok: int
    n_failed: int
    n_skipped: int
    n_open: int
    rank: float | None
    n_ranked: int
    ratio: float | None = None
    p: float | None = None
    n_conditions: int = 0


def overall_of(methods: Sequence[str], entries: MethodResults, metric: Metric) -> list[Overall]:
    """Return a row for each method, ranked and compared by one quantity."""
    ranks = _ranks(entries, metric)
    return [_row(method, [e for e in entries.values() if e.method == method], ranks, metric) for method in methods]


def _row(method: str, entries: Sequence[MethodResult], ranks: Mapping[str, Sequence[float]], metric: Metric) -> Overall:
    counts: Counter[str] = Counter()
    for entry in entries:
        counts.update(entry.counts)
    pairs = [entry.comparisons[metric.name][0] for entry in entries if metric.name in entry.comparisons]
    ratios = [pair.ratio for pair in pairs if pair.ratio is not None]
    own = ranks.get(method, [])
    return Overall(
        method=method,
        n_ok=counts["ok"],
        n_failed=sum(counts[state] for state in UNSUCCESSFUL),
        n_skipped=counts["skipped"],
        n_open=counts["pending"] + counts["running"],
        rank=sum(own) / len(own) if own else None,
        n_ranked=len(own),
        ratio=median(ratios) if ratios and len(ratios) == len(pairs) else None,
        p=compare_pairs([pair.difference for pair in pairs], [0.0] * len(pairs)).p if pairs else None,
        n_conditions=len(pairs),
    )


def _fixed_for_all(entries: MethodResults, metric: Metric) -> dict[str, frozenset[str]]:
    """Return by condition the places in which seeds change no method."""
    found: dict[str, frozenset[str]] = {}
    for entry in entries.values():
        if entry.values[metric.name]:
            fixed = entry.fixed_for(metric)
            found[entry.condition] = found.get(entry.condition, fixed) & fixed
    return found


def _ranks(entries: MethodResults, metric: Metric) -> dict[str, list[float]]:
    """Return the ranks of each method, one for each condition, place and seed that two methods at least have.

    Where seeds change no method there is one rank.
    """
    fixed = _fixed_for_all(entries, metric)
    groups: dict[tuple[str, str, Any], dict[str, float]] = {}
    for entry in entries.values():
        for (place, seed), value in entry.values[metric.name].items():
            trial = (place, None if place in fixed[entry.condition] else seed)
            groups.setdefault((entry.condition, *trial), {})[entry.method] = metric.oriented(value)
    ranks: dict[str, list[float]] = {}
    for group in groups.values():
        if len(group) > 1:
            for method, rank in zip(group, mean_ranks([list(group.values())]), strict=True):
                ranks.setdefault(method, []).append(rank)
    return ranks
