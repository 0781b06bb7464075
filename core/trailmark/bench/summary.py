"""What the cells of a bench say together: by method and condition, against a baseline, in ranks."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from trailmark.bench.cell import UNSUCCESSFUL
from trailmark.bench.index import Index, Record
from trailmark.bench.statistics import Comparison, Spread, compare_all, compare_pairs, holm, mean_ranks, spreads
from trailmark.errors import ConfigError
from trailmark.evaluation import find_metric
from trailmark.plugins.hints import nearest_or_all

__all__ = ["Entry", "Metric", "Namer", "Overall", "Summary", "metric_of", "summarized"]

_METHOD_AXES = ("localizer", "estimator", "controller", "pipeline")
_CONDITION_AXES = ("source", "perturbation")

_HIGHER = ("tracked_fraction", "frames_per_s")
_NEAR_ONE = ("nees_per_dof", "nis_per_dof")
_OF_PROCESS = ("wall_s", "cpu_s", "peak_rss_mb")

# Without ground truth there are differences, and they have names of their own.
_DIFFERENCES = {
    "ate_rmse_m": "difference_rmse_m",
    "ate_max_m": "difference_max_m",
    "ate_heading_rmse_deg": "difference_heading_rmse_deg",
    "rpe_rmse_m": "relative_difference_rmse_m",
    "end_error_m": "end_difference_m",
}


@dataclass(frozen=True, slots=True)
class Metric:
    """A quantity of the tables.

    Attributes
    ----------
    name : str
        As in ``metrics.json``, without its protocol: ``ate_rmse_m``.
    better : {"lower", "higher", "near one"}
        Which way is better.
    """

    name: str
    better: Literal["lower", "higher", "near one"] = "lower"

    def oriented(self, value: float) -> float:
        """Return a number that is lower where the value is better."""
        if self.better == "higher":
            return -value
        if self.better == "near one":
            return abs(math.log(value)) if value > 0 else math.inf
        return value

    def value_of(self, record: Record) -> float | None:
        """Return the value of a cell; None where it was not measured."""
        if self.name in _OF_PROCESS:
            found = getattr(record, self.name)
            return None if found is None else float(found)
        times = record.result.get("times", {})
        if self.name in times:
            return float(times[self.name])
        metrics = record.result.get("metrics", {})
        alignment = record.result.get("alignment")
        value = find_metric(metrics, self.name, *([alignment] if alignment else []))
        return find_metric(metrics, self.name) if value is None else value


def metric_of(name: str) -> Metric:
    """Return the quantity of a name."""
    return Metric(name, "higher" if name in _HIGHER else "near one" if name in _NEAR_ONE else "lower")


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """One method under one condition, over its seeds.

    Attributes
    ----------
    method, condition : str
        In words.
    counts : mapping of str to int
        Cells by state.
    values : mapping of str to dict of int to float
        By metric, seed to value; a failure is infinite in the direction that is worse.
    spreads : dict of str to Spread
        By metric, of oriented values.
    comparisons : dict of str to (Comparison, float or None)
        By metric, with the p-value adjusted for the number of comparisons.
    """

    method: str
    condition: str
    counts: Mapping[str, int]
    values: Mapping[str, Mapping[Any, float]]
    spreads: dict[str, Spread] = field(default_factory=dict)
    comparisons: dict[str, tuple[Comparison, float | None]] = field(default_factory=dict)

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
        """Return an oriented number as the quantity is told."""
        return oriented if oriented is None or metric.better != "higher" else -oriented


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
        Mean rank by the first metric, among the methods of the same condition and seed; 1 is best.
    n_ranked : int
        Pairs of condition and seed behind it.
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


@dataclass(frozen=True, slots=True, eq=False)
class Summary:
    """The statistics of a bench.

    Attributes
    ----------
    name : str
        Of the bench.
    metrics : tuple of Metric
        The first one ranks.
    methods, conditions : tuple of str
        In their order.
    entries : mapping of (method, condition) to Entry
        Those that the matrices have.
    overall : tuple of Overall
        A row for each method.
    baseline : str or None
        The method compared with, as it was written.
    counts : mapping of str to int
        Cells by state.
    reasons : mapping of str to int
        Why cells failed or were skipped, and how often.
    """

    name: str
    metrics: tuple[Metric, ...]
    methods: tuple[str, ...]
    conditions: tuple[str, ...]
    entries: Mapping[tuple[str, str], Entry]
    overall: tuple[Overall, ...]
    baseline: str | None
    counts: Mapping[str, int]
    reasons: Mapping[str, int]

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
            "entries": entries,
            "reasons": dict(self.reasons),
        }


def summarized(index: Index, metrics: Sequence[str] = (), baseline: str | None = None) -> Summary:
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
    names = tuple(metrics) or tuple(meta.get("metrics", ())) or ("ate_rmse_m",)
    chosen = tuple(metric_of(name) for name in (_named(name, records) for name in names))
    if metrics:
        _refuse_unknown(metrics, chosen, records)
    baseline = baseline if baseline is not None else meta.get("baseline")
    namer = Namer(records)
    entries = _entries(records, chosen, namer)
    axis = None if baseline is None else _axis_of(baseline, records)
    if axis is not None and baseline is not None:
        _compare(entries, records, chosen, namer, axis, baseline)
    methods = tuple(dict.fromkeys(entry.method for entry in entries.values()))
    return Summary(
        name=str(meta.get("name", index.folder.name)),
        metrics=chosen,
        methods=methods,
        conditions=tuple(dict.fromkeys(entry.condition for entry in entries.values())),
        entries=entries,
        overall=tuple(_overall(methods, entries, chosen[0])),
        baseline=baseline,
        counts=dict(Counter(record.state for record in records).most_common()),
        reasons=dict(Counter(_reason(record) for record in records if record.reason).most_common()),
    )


class Namer:
    """Names methods and conditions by the axes that differ; where none does, by the first."""

    def __init__(self, records: Sequence[Record]) -> None:
        values: dict[str, set[Any]] = {}
        for record in records:
            for axis, value in {"matrix": record.matrix, **record.coordinates}.items():
                values.setdefault(axis, set()).add(value)
        self._method = _telling(_METHOD_AXES, values)
        self._condition = _telling(("matrix", *_CONDITION_AXES), values)

    def method(self, record: Record) -> str:
        return " + ".join(str(record.coordinates[axis]) for axis in self._method if axis in record.coordinates) or "run"

    def condition(self, record: Record) -> str:
        known = {"matrix": record.matrix, **record.coordinates}
        return ", ".join(str(known[axis]) for axis in self._condition if known.get(axis)) or "all"


def _telling(axes: Sequence[str], values: Mapping[str, set[Any]]) -> list[str]:
    several = [axis for axis in axes if len(values.get(axis, ())) > 1]
    return several or [axis for axis in axes if values.get(axis) and axis != "matrix"][:1]


def _entries(records: Sequence[Record], metrics: Sequence[Metric], namer: Namer) -> dict[tuple[str, str], Entry]:
    groups: dict[tuple[str, str], list[Record]] = {}
    for record in records:
        groups.setdefault((namer.method(record), namer.condition(record)), []).append(record)
    groups = {key: group for key, group in groups.items() if any(record.state != "skipped" for record in group)}
    entries = {
        (method, condition): Entry(
            method,
            condition,
            dict(Counter(record.state for record in group)),
            {metric.name: _values(metric, group) for metric in metrics},
        )
        for (method, condition), group in groups.items()
    }
    for metric in metrics:
        known = [entry for entry in entries.values() if _is_measured(entry, metric)]
        rows = [list(entry.values[metric.name].values()) for entry in known]
        if metric.better != "near one":  # of what should be one, the sides are told apart
            rows = [[_oriented(metric, value) for value in row] for row in rows]
        for entry, spread in zip(known, spreads(rows), strict=True):
            entry.spreads[metric.name] = spread
    return entries


def _is_measured(entry: Entry, metric: Metric) -> bool:
    """Whether there is a number, or only failures: without any result, failures alone tell."""
    values = entry.values[metric.name]
    return bool(values) and (entry.n_ok == 0 or any(math.isfinite(value) for value in values.values()))


def _values(metric: Metric, records: Sequence[Record]) -> dict[Any, float]:
    """Return the value of each seed; of a failure infinity, on the worse side; what was not measured is left out."""
    worst = -math.inf if metric.better == "higher" else math.inf
    found: dict[Any, float] = {}
    for record in records:
        key = _pair_key(record)
        if record.state in UNSUCCESSFUL:
            found[key] = worst
        elif record.state == "ok" and (value := metric.value_of(record)) is not None:
            found[key] = value
    return found


def _pair_key(record: Record) -> Any:
    return record.coordinates.get("seed", 0)


def _oriented(metric: Metric, value: float) -> float:
    return metric.oriented(value) if math.isfinite(value) else math.inf


def _axis_of(baseline: str, records: Sequence[Record]) -> str:
    axes = [axis for axis in _METHOD_AXES if any(record.coordinates.get(axis) == baseline for record in records)]
    if len(axes) == 1:
        return axes[0]
    known = {str(record.coordinates[axis]) for record in records for axis in _METHOD_AXES if axis in record.coordinates}
    if not axes:
        hint = nearest_or_all(baseline, sorted(known), "methods")
        raise ConfigError(
            f"baseline {baseline!r} is no localizer, estimator, controller or pipeline of the cells{hint}"
        )
    raise ConfigError(f"baseline {baseline!r} is a {' and a '.join(axes)}: rename one of them")


def _compare(
    entries: Mapping[tuple[str, str], Entry],
    records: Sequence[Record],
    metrics: Sequence[Metric],
    namer: Namer,
    axis: str,
    baseline: str,
) -> None:
    """Compare each entry with the one that differs in the baseline's axis alone, seed by seed."""
    partner: dict[tuple[str, str], tuple[str, str]] = {}
    by_rest: dict[tuple[Any, ...], tuple[str, str]] = {}
    for record in records:
        if record.coordinates.get(axis) == baseline:
            by_rest[_rest(record, axis)] = (namer.method(record), namer.condition(record))
    for record in records:
        found = by_rest.get(_rest(record, axis))
        if found is not None and record.coordinates.get(axis) != baseline:
            partner[namer.method(record), namer.condition(record)] = found
    for metric in metrics:
        compared: list[Entry] = []
        rows: list[tuple[list[float], list[float]]] = []
        for key, other in partner.items():
            ours, theirs = entries[key].values[metric.name], entries[other].values[metric.name]
            seeds = [seed for seed in ours if seed in theirs]
            if seeds:
                compared.append(entries[key])
                rows.append(
                    ([_oriented(metric, ours[s]) for s in seeds], [_oriented(metric, theirs[s]) for s in seeds])
                )
        pairs = compare_all(rows)
        for entry, pair, adjusted in zip(compared, pairs, holm([pair.p for pair in pairs]), strict=True):
            entry.comparisons[metric.name] = (pair, adjusted)


def _rest(record: Record, axis: str) -> tuple[Any, ...]:
    kept = tuple((key, value) for key, value in record.coordinates.items() if key not in (axis, "seed"))
    return (record.matrix, kept)


def _overall(methods: Sequence[str], entries: Mapping[tuple[str, str], Entry], metric: Metric) -> list[Overall]:
    ranks = _ranks_of(entries, metric)
    rows = []
    for method in methods:
        own = [entry for entry in entries.values() if entry.method == method]
        counts: Counter[str] = Counter()
        for entry in own:
            counts.update(entry.counts)
        pairs = [entry.comparisons[metric.name][0] for entry in own if metric.name in entry.comparisons]
        ratios = [pair.ratio for pair in pairs if pair.ratio is not None]
        between = compare_pairs([pair.difference for pair in pairs], [0.0] * len(pairs)) if pairs else None
        found = ranks.get(method, [])
        rows.append(
            Overall(
                method=method,
                n_ok=counts["ok"],
                n_failed=sum(counts[state] for state in UNSUCCESSFUL),
                n_skipped=counts["skipped"],
                n_open=counts["pending"] + counts["running"],
                rank=sum(found) / len(found) if found else None,
                n_ranked=len(found),
                ratio=sorted(ratios)[len(ratios) // 2] if ratios and len(ratios) == len(pairs) else None,
                p=None if between is None else between.p,
                n_conditions=len(pairs),
            )
        )
    return rows


def _ranks_of(entries: Mapping[tuple[str, str], Entry], metric: Metric) -> dict[str, list[float]]:
    """Return the ranks of each method, one for each condition and seed that two methods at least have."""
    groups: dict[tuple[str, Any], dict[str, float]] = {}
    for entry in entries.values():
        for seed, value in entry.values[metric.name].items():
            groups.setdefault((entry.condition, seed), {})[entry.method] = _oriented(metric, value)
    ranks: dict[str, list[float]] = {}
    for group in groups.values():
        if len(group) > 1:
            for method, rank in zip(group, mean_ranks([list(group.values())]), strict=True):
                ranks.setdefault(method, []).append(rank)
    return ranks


def _named(name: str, records: Sequence[Record]) -> str:
    """Return the name of a quantity, or of the difference that stands for it where no cell has a ground truth."""
    finished = [record for record in records if record.state == "ok"]
    other = _DIFFERENCES.get(name)
    has_truth = any(record.result.get("errors") for record in finished)
    return other if other is not None and finished and not has_truth else name


def _refuse_unknown(asked: Sequence[str], metrics: Sequence[Metric], records: Sequence[Record]) -> None:
    finished = [record for record in records if record.state == "ok"]
    for name, metric in zip(asked, metrics, strict=True):
        if finished and all(metric.value_of(record) is None for record in finished):
            known = {key.partition("[")[0] for record in finished for key in record.result.get("metrics", {})}
            known |= {key for record in finished for key in record.result.get("times", {})} | set(_OF_PROCESS)
            raise ConfigError(f"no cell has a metric {name!r}{nearest_or_all(name, sorted(known), 'metrics')}")


def _reason(record: Record) -> str:
    return f"{record.state}: {record.reason}"[:160]


def _entry_document(entry: Entry, metric: Metric) -> dict[str, Any] | None:
    spread = entry.spreads.get(metric.name)
    if spread is None:
        return None
    sides = [entry.shown(metric, value) for value in (spread.q1, spread.q3, spread.low, spread.high)]
    if metric.better == "higher":
        sides = [sides[1], sides[0], sides[3], sides[2]]
    document: dict[str, Any] = {
        "n": spread.n,
        "median": _plain(entry.median(metric)),
        **{key: _plain(value) for key, value in zip(("q1", "q3", "low", "high"), sides, strict=True)},
    }
    if metric.name in entry.comparisons:
        pair, adjusted = entry.comparisons[metric.name]
        document["versus"] = {key: _plain(getattr(pair, key)) for key in Comparison.__slots__} | {"p_holm": adjusted}
    return document


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
