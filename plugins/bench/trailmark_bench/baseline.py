"""Each method against a baseline, seed by seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from trailmark.errors import ConfigError
from trailmark.plugins.hints import nearest_or_all
from trailmark_bench.entries import MethodResult, MethodResults
from trailmark_bench.index import CellRecord
from trailmark_bench.naming import METHOD_AXES, Namer
from trailmark_bench.quantities import Metric
from trailmark_bench.statistics import compare_all, holm

__all__ = ["compare_with"]

_Key = tuple[str, str]


def compare_with(
    baseline: str, entries: MethodResults, records: Sequence[CellRecord], metrics: Sequence[Metric], namer: Namer
) -> None:
    """Write into each entry how it compares with the one that differs in the baseline's axis alone.

    Raises
    ------
    ConfigError
        If the baseline is no value of a method's axis, or one of several.
    """
    partners = _partners(_axis_of(baseline, records), baseline, records, namer)
    for metric in metrics:
        _compare(entries, partners, metric)


def _partners(axis: str, baseline: str, records: Sequence[CellRecord], namer: Namer) -> dict[_Key, _Key]:
    """Return the entry to compare with of every entry that has one."""
    baselines = {
        _rest(record, axis): (namer.method(record), namer.condition(record))
        for record in records
        if record.coordinates.get(axis) == baseline
    }
    return {
        (namer.method(record), namer.condition(record)): baselines[_rest(record, axis)]
        for record in records
        if record.coordinates.get(axis) != baseline and _rest(record, axis) in baselines
    }


def _rest(record: CellRecord, axis: str) -> tuple[Any, ...]:
    kept = tuple((key, value) for key, value in record.coordinates.items() if key not in (axis, "seed"))
    return (record.matrix, kept)


def _compare(entries: MethodResults, partners: Mapping[_Key, _Key], metric: Metric) -> None:
    """Compare seed by seed; one adjustment of p covers all."""
    compared: list[MethodResult] = []
    rows: list[tuple[list[float], list[float]]] = []
    for key, other in partners.items():
        if key not in entries or other not in entries:  # skipped
            continue
        ours, theirs = entries[key].values[metric.name], entries[other].values[metric.name]
        seeds = [seed for seed in ours if seed in theirs]
        if seeds:
            compared.append(entries[key])
            rows.append(([metric.oriented(ours[s]) for s in seeds], [metric.oriented(theirs[s]) for s in seeds]))
    pairs = compare_all(rows)
    for entry, pair, adjusted in zip(compared, pairs, holm([pair.p for pair in pairs]), strict=True):
        entry.comparisons[metric.name] = (pair, adjusted)


def _axis_of(baseline: str, records: Sequence[CellRecord]) -> str:
    axes = [axis for axis in METHOD_AXES if any(record.coordinates.get(axis) == baseline for record in records)]
    if len(axes) == 1:
        return axes[0]
    known = {str(record.coordinates[axis]) for record in records for axis in METHOD_AXES if axis in record.coordinates}
    if not axes:
        hint = nearest_or_all(baseline, sorted(known), "methods")
        raise ConfigError(
            f"baseline {baseline!r} is no localizer, estimator, controller or pipeline of the cells{hint}"
        )
    raise ConfigError(f"baseline {baseline!r} is a {' and a '.join(axes)}: rename one of them")
