"""One method under one condition, over its places and seeds."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from trailmark_bench.cell import UNSUCCESSFUL
from trailmark_bench.index import CellRecord
from trailmark_bench.naming import Namer
from trailmark_bench.nested import spreads_of_samples
from trailmark_bench.quantities import Metric
from trailmark_bench.sampling import Trial, fixed_places, samples_by_place, trial_of
from trailmark_bench.statistics import Comparison, SampleSpread

__all__ = ["MethodResult", "MethodResults", "entries_of", "entries_of_groups"]


@dataclass(frozen=True, slots=True, eq=False)
class MethodResult:
    """One method under one condition, over its places and seeds.

    Attributes
    ----------
    method, condition : str
        In words.
    counts : mapping of str to int
        Cells by state.
    values : mapping of str to dict of Trial to float
        By metric, place and seed to value; a failure is infinite in the direction that is worse.
    fixed : frozenset of str
        Places in which seeds change nothing: one sample each.
    spreads : dict of str to SampleSpread
        By metric, of oriented values.
    comparisons : dict of str to (Comparison, float or None)
        By metric, with the p-value adjusted for the number of comparisons.
    """

    method: str
    condition: str
    counts: Mapping[str, int]
    values: Mapping[str, Mapping[Trial, float]]
    fixed: frozenset[str] = frozenset()
    spreads: dict[str, SampleSpread] = field(default_factory=dict)
    comparisons: dict[str, tuple[Comparison, float | None]] = field(default_factory=dict)

    @property
    def is_deterministic(self) -> bool:
        """Whether seeds change nothing, in any of its places."""
        return all({place for place, _ in values} <= self.fixed for values in self.values.values()) and bool(self.fixed)

    def fixed_for(self, metric: Metric) -> frozenset[str]:
        """Return the places in which seeds do not change a quantity; what a clock has measured is never the same."""
        return frozenset() if metric.is_of_machine else self.fixed

    @property
    def n_ok(self) -> int:
        """Cells with a result."""
        return self.counts.get("ok", 0)

    @property
    def n_failed(self) -> int:
        """Cells that ran and gave none."""
        return sum(self.counts.get(state, 0) for state in UNSUCCESSFUL)

    def median(self, metric: Metric) -> float | None:
        """Return the median over seeds, failures as the worst; infinite where they decide; None: not measured."""
        spread = self.spreads.get(metric.name)
        return None if spread is None else self.shown(metric, spread.median)

    def shown(self, metric: Metric, oriented: float | None) -> float | None:
        """Return an oriented number in the quantity's own orientation."""
        return oriented if oriented is None or metric.better != "higher" else -oriented


#: By method and condition.
MethodResults = Mapping[tuple[str, str], MethodResult]


def entries_of(
    records: Sequence[CellRecord], metrics: Sequence[Metric], namer: Namer
) -> dict[tuple[str, str], MethodResult]:
    """Return the entries of those that ran, with the spread of every quantity that was measured."""
    groups: dict[tuple[str, str], list[CellRecord]] = {}
    for record in records:
        groups.setdefault((namer.method(record), namer.condition(record)), []).append(record)
    ran = {key: group for key, group in groups.items() if any(record.state != "skipped" for record in group)}
    return entries_of_groups(ran, metrics)


def entries_of_groups(
    groups: Mapping[tuple[str, str], Sequence[CellRecord]], metrics: Sequence[Metric]
) -> dict[tuple[str, str], MethodResult]:
    """Return the entry of each group of cells, by method and condition, with the spread of what was measured."""
    entries = {
        (method, condition): MethodResult(
            method,
            condition,
            dict(Counter(record.state for record in group)),
            {metric.name: _values(metric, group) for metric in metrics},
            fixed_places(group),
        )
        for (method, condition), group in groups.items()
    }
    for metric in metrics:
        _add_spreads(entries, metric)
    return entries


def _add_spreads(entries: MethodResults, metric: Metric) -> None:
    known = [entry for entry in entries.values() if _is_measured(entry, metric)]
    rows = [samples_by_place(entry.values[metric.name], entry.fixed_for(metric)) for entry in known]
    if metric.better != "near one":  # of what should be one, the sides are told apart
        rows = [[[metric.oriented(value) for value in place] for place in row] for row in rows]
    for entry, spread in zip(known, spreads_of_samples(rows), strict=True):
        entry.spreads[metric.name] = spread


def _is_measured(entry: MethodResult, metric: Metric) -> bool:
    """Whether there is a number, or only failures, which count where there is no result at all."""
    values = entry.values[metric.name]
    return bool(values) and (entry.n_ok == 0 or any(math.isfinite(value) for value in values.values()))


def _values(metric: Metric, records: Sequence[CellRecord]) -> dict[Trial, float]:
    """Return the value of each place and seed; of a failure the worse infinity; what was not measured is left out."""
    worst = -math.inf if metric.better == "higher" else math.inf
    found: dict[Trial, float] = {}
    for record in records:
        if record.state in UNSUCCESSFUL:
            found[trial_of(record)] = worst
        elif record.state == "ok" and (value := metric.value_of(record)) is not None:
            found[trial_of(record)] = value
    return found
