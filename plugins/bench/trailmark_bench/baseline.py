"""Each method against a baseline, on equal places and seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from trailmark.errors import ConfigError
from trailmark.plugins.hints import nearest_or_all
from trailmark_bench.entries import MethodResult, MethodResults
from trailmark_bench.index import CellRecord
from trailmark_bench.naming import METHOD_AXES, Namer
from trailmark_bench.nested import Samples, compare_samples
from trailmark_bench.quantities import Metric
from trailmark_bench.sampling import samples_by_place
from trailmark_bench.statistics import holm

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
    """Compare on equal places and seeds; one adjustment of p covers all."""
    compared: list[MethodResult] = []
    rows: list[tuple[Samples, Samples]] = []
    for key, other in partners.items():
        if key not in entries or other not in entries:  # skipped
            continue
        row = _paired_samples(entries[key], entries[other], metric)
        if row[0]:
            compared.append(entries[key])
            rows.append(row)
    pairs = compare_samples(rows)
    for entry, pair, adjusted in zip(compared, pairs, holm([pair.p for pair in pairs]), strict=True):
        entry.comparisons[metric.name] = (pair, adjusted)


def _paired_samples(ours: MethodResult, theirs: MethodResult, metric: Metric) -> tuple[Samples, Samples]:
    """Return oriented values of equal places and seeds; where seeds change neither, a place gives one pair."""
    values, others = ours.values[metric.name], theirs.values[metric.name]
    fixed = ours.fixed_for(metric) & theirs.fixed_for(metric)
    common = [trial for trial in values if trial in others]
    return (
        samples_by_place({trial: metric.oriented(values[trial]) for trial in common}, fixed),
        samples_by_place({trial: metric.oriented(others[trial]) for trial in common}, fixed),
    )


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
