"""What the cells of a bench say together: by method and condition, against a baseline, in ranks."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from trailmark_bench.baseline import compare_with
from trailmark_bench.entries import MethodResult, MethodResults, entries_of
from trailmark_bench.floor import FLOOR, floor_entries
from trailmark_bench.improvement import Improvement, improvements
from trailmark_bench.index import CellRecord, Index
from trailmark_bench.naming import Namer
from trailmark_bench.overall import Overall, overall_of
from trailmark_bench.quantities import Metric, metrics_of, refuse_unknown
from trailmark_bench.statistics import Comparison

__all__ = ["BenchSummary", "summarize_bench"]


@dataclass(frozen=True, slots=True, eq=False)
class BenchSummary:
    """The statistics of a bench.

    Attributes
    ----------
    name : str
        Of the bench.
    metrics : tuple of Metric
        The first one ranks.
    methods, conditions : tuple of str
        In their order; last the robot that stands still, where there is ground truth.
    entries : mapping of (method, condition) to MethodResult
        Those that the matrices have, and those of the robot that stands still, which is not ranked.
    overall : tuple of Overall
        A row for each method.
    baseline : str or None
        The method compared with, as it was written.
    counts : mapping of str to int
        Cells by state.
    reasons : mapping of str to int
        Why cells failed or were skipped, and how often.
    improvements : tuple of Improvement
        By the first metric, each method against each other.
    """

    name: str
    metrics: tuple[Metric, ...]
    methods: tuple[str, ...]
    conditions: tuple[str, ...]
    entries: MethodResults
    overall: tuple[Overall, ...]
    baseline: str | None
    counts: Mapping[str, int]
    reasons: Mapping[str, int]
    improvements: tuple[Improvement, ...] = ()

    def lines(self) -> list[str]:
        """Return what stands below the tables: how many cells are in which state, and why."""
        states = ", ".join(f"{count} {state}" for state, count in self.counts.items())
        why = [f"  {count} x {reason}" for reason, count in list(self.reasons.items())[:12]]
        return [f"{sum(self.counts.values())} cells: {states}", *why]

    def document(self) -> dict[str, Any]:
        """Return everything as plain data; numbers that are not finite become null."""
        entries = [
            {
                "method": entry.method,
                "condition": entry.condition,
                "cells": dict(entry.counts),
                "deterministic": entry.is_deterministic,
                "metrics": {metric.name: _entry_document(entry, metric) for metric in self.metrics},
            }
            for entry in self.entries.values()
        ]
        overall = [{key: _plain(getattr(row, key)) for key in Overall.__slots__} for row in self.overall]
        return {
            "bench": self.name,
            "cells": dict(self.counts),
            "baseline": self.baseline,
            "metrics": {metric.name: metric.better for metric in self.metrics},
            "overall": overall,
            "improvements": [asdict(improvement) for improvement in self.improvements],
            "entries": entries,
            "reasons": dict(self.reasons),
        }


def summarize_bench(index: Index, metrics: Sequence[str] = (), baseline: str | None = None) -> BenchSummary:
    """Return the statistics of a bench.

    Parameters
    ----------
    index : Index
        Of the bench.
    metrics : sequence of str
        Quantities; default: those of its config.
    baseline : str, optional
        In place of that of its config.

    Raises
    ------
    ConfigError
        If no cell has such a quantity, or the baseline is no value of a method's axis.
    """
    records, meta = index.records(), index.meta()
    chosen = metrics_of(tuple(metrics) or tuple(meta.get("metrics", ())) or ("ate_rmse_m",), records)
    if metrics:
        refuse_unknown(metrics, chosen, records)
    baseline = baseline if baseline is not None else meta.get("baseline")
    namer = Namer(records)
    entries = entries_of(records, chosen, namer)
    if baseline is not None:
        compare_with(baseline, entries, records, chosen, namer)
    methods = tuple(dict.fromkeys(entry.method for entry in entries.values()))
    floor = floor_entries(records, chosen, namer)
    return BenchSummary(
        name=str(meta.get("name", index.folder.name)),
        metrics=chosen,
        methods=(*methods, FLOOR) if floor else methods,
        conditions=tuple(dict.fromkeys(entry.condition for entry in entries.values())),
        entries={**entries, **floor},
        overall=tuple(overall_of(methods, entries, chosen[0])),
        baseline=baseline,
        counts=dict(Counter(record.state for record in records).most_common()),
        improvements=tuple(improvements(methods, entries, chosen[0])),
        reasons=dict(Counter(_reason(record) for record in records if record.reason).most_common()),
    )


def _reason(record: CellRecord) -> str:
    return f"{record.state}: {record.reason}"[:160]


def _entry_document(entry: MethodResult, metric: Metric) -> dict[str, Any] | None:
    spread = entry.spreads.get(metric.name)
    if spread is None:
        return None
    sides = [entry.shown(metric, value) for value in (spread.q1, spread.q3, spread.low, spread.high)]
    if metric.better == "higher":
        sides = [sides[1], sides[0], sides[3], sides[2]]
    document: dict[str, Any] = {
        "n": spread.n,
        "places": spread.n_places,
        "median": _plain(entry.median(metric)),
        **{key: _plain(value) for key, value in zip(("q1", "q3", "low", "high"), sides, strict=True)},
    }
    if metric.name in entry.comparisons:
        pair, adjusted = entry.comparisons[metric.name]
        document["versus"] = {key: _plain(getattr(pair, key)) for key in Comparison.__slots__} | {"p_holm": adjusted}
    return document


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
