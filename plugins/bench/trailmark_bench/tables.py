"""The tables of a bench, for the terminal, papers and pages."""

from __future__ import annotations

import math
from collections.abc import Iterable

from trailmark.report.numbers import MISSING, length_unit, significant
from trailmark.report.tables import Column, Table
from trailmark_bench.entries import MethodResult
from trailmark_bench.overall import Overall
from trailmark_bench.quantities import Metric
from trailmark_bench.statistics import RESAMPLES, SampleSpread
from trailmark_bench.summary import BenchSummary

__all__ = ["FAILED", "bench_tables", "counts_text", "metric_title", "scaled_column", "value_text"]

#: Stands where failures are so many that the median is one.
FAILED = "failed"

# Methods in the matrix of probabilities.
_MOST_COMPARED = 8
_UNITS = {
    "_ms_per_m": "ms/m",
    "_deg_per_m": "°/m",
    "_m": "m",
    "_deg": "°",
    "_percent": "%",
    "_ms": "ms",
    "_s": "s",
    "_mb": "MB",
    "_mm": "mm",
}


def bench_tables(summary: BenchSummary) -> list[Table]:
    """Return the tables: medians, spread and comparison of the first metric, and the methods over all."""
    tables = [_medians(summary)]
    if summary.baseline is not None or any(entry.n_ok + entry.n_failed > 1 for entry in summary.entries.values()):
        tables.append(_spread(summary))
    if len(summary.methods) > 1:
        tables.append(_overall(summary))
    if summary.improvements:
        tables.append(_improvement(summary))
    return tables


def metric_title(metric: Metric) -> tuple[str, str]:
    """Return title and unit of a quantity's column."""
    for suffix, unit in _UNITS.items():
        if metric.name.endswith(suffix):
            words = metric.name.removesuffix(suffix)
            return words.replace("ate_", "ATE ").replace("rpe_", "RPE ").replace("_", " "), unit
    return metric.name.replace("_", " "), ""


def value_text(value: float | None, per_unit: float = 1.0) -> str:
    """Return a number, a dash where nothing was measured, ``failed`` where failures decide."""
    if value is None:
        return MISSING
    return FAILED if math.isinf(value) else significant(per_unit * value)


def scaled_column(title: str, unit: str, values: Iterable[float | None]) -> tuple[Column, float]:
    """Return a column of lengths in the unit that suits them, and how many of it make one of the quantity's own."""
    if unit != "m":
        return Column(title, unit), 1.0
    name, per_m = length_unit(value for value in values if value is not None)
    return Column(title, name), per_m


def counts_text(entry: MethodResult) -> str:
    """Return how many of the cells gave a result: ``4/5``; of those that were skipped nothing is expected."""
    total = sum(count for state, count in entry.counts.items() if state != "skipped")
    return f"{entry.n_ok}/{total}" if total else "skipped"


def _medians(summary: BenchSummary) -> Table:
    shown = [metric for metric in summary.metrics if any(metric.name in e.spreads for e in summary.entries.values())]
    columns = [Column("condition", is_number=False), Column("method", is_number=False), Column("ok")]
    entries = _in_order(summary)
    scaled = [scaled_column(*metric_title(metric), [entry.median(metric) for entry in entries]) for metric in shown]
    columns += [column for column, _ in scaled]
    rows = []
    last = ""
    for entry in entries:
        cells = [value_text(entry.median(m), per_unit) for m, (_, per_unit) in zip(shown, scaled, strict=True)]
        rows.append(("" if entry.condition == last else entry.condition, entry.method, counts_text(entry), *cells))
        last = entry.condition
    notes = [
        "Medians over seeds, of several places over the medians of each; a failed cell counts as the worst result."
    ]
    return Table(tuple(columns), tuple(rows), tuple(notes))


def _spread(summary: BenchSummary) -> Table:
    metric = summary.metrics[0]
    title, unit = metric_title(metric)
    columns = [Column("condition", is_number=False), Column("method", is_number=False), Column("n")]
    entries = _in_order(summary)
    median, per_unit = scaled_column(f"median {title}", unit, [entry.median(metric) for entry in entries])
    columns += [median, Column("quartiles", median.unit), Column("95 %", median.unit)]
    if summary.baseline is not None:
        columns += [Column("times baseline"), Column("better/ worse"), Column("p"), Column("p Holm")]
    rows = []
    last = ""
    for entry in entries:
        row = ["" if entry.condition == last else entry.condition, entry.method]
        row += _spread_cells(entry, metric, per_unit)
        last = entry.condition
        rows.append(tuple(row + (_pair_cells(entry, metric) if summary.baseline is not None else [])))
    notes = [f"95 %: interval of the median by the percentile bootstrap, {RESAMPLES} resamples; from 3 seeds on."]
    if any(entry.is_deterministic for entry in entries):
        notes.append("Deterministic: n = 1, because another seed changes nothing.")
    if any(spread.n_places > 1 for entry in entries for spread in entry.spreads.values()):
        notes.append("Of several places each counts once; intervals draw places, then seeds in them; p is over places.")
    if summary.baseline is not None:
        notes.append(
            f"Pairs of equal seeds with {summary.baseline}; p: Wilcoxon's signed ranks, two-sided; Holm: for all rows."
        )
    return Table(tuple(columns), tuple(rows), tuple(notes))


def _spread_cells(entry: MethodResult, metric: Metric, per_unit: float) -> list[str]:
    spread = entry.spreads.get(metric.name)
    if spread is None:
        return [MISSING] * 4
    low, high = _sides(entry, metric, spread.q1, spread.q3)
    interval = MISSING
    if spread.low is not None and spread.high is not None:
        interval = _range_text(*_sides(entry, metric, spread.low, spread.high), per_unit)
    quartiles = _range_text(low, high, per_unit) if spread.n > 1 else MISSING
    return [_n_text(entry, metric, spread), value_text(entry.median(metric), per_unit), quartiles, interval]


def _n_text(entry: MethodResult, metric: Metric, spread: SampleSpread) -> str:
    if spread.n_places > 1:
        return f"{spread.n} in {spread.n_places} places"
    return f"{spread.n} (deterministic)" if entry.is_deterministic and not metric.is_of_machine else str(spread.n)


def _range_text(low: float | None, high: float | None, per_unit: float) -> str:
    return f"{value_text(low, per_unit)} {MISSING} {value_text(high, per_unit)}"


def _sides(entry: MethodResult, metric: Metric, low: float, high: float) -> tuple[float | None, float | None]:
    sides = entry.shown(metric, low), entry.shown(metric, high)
    return (sides[1], sides[0]) if metric.better == "higher" else sides


def _pair_cells(entry: MethodResult, metric: Metric) -> list[str]:
    found = entry.comparisons.get(metric.name)
    if found is None:
        return [MISSING] * 4
    pair, adjusted = found
    return [significant(pair.ratio), f"{pair.wins}/{pair.losses}", _p_text(pair.p), _p_text(adjusted)]


def _overall(summary: BenchSummary) -> Table:
    columns = [
        Column("method", is_number=False),
        Column("ok"),
        Column("failed"),
        Column("skipped"),
        Column("mean rank"),
    ]
    columns += [Column("of")]
    if summary.baseline is not None:
        columns += [Column("times baseline"), Column("conditions"), Column("p")]
    rows = []
    for row in sorted(summary.overall, key=lambda row: (row.rank is None, row.rank)):
        cells = [row.method, str(row.n_ok), str(row.n_failed), str(row.n_skipped), significant(row.rank)]
        cells.append(str(row.n_ranked) if row.n_ranked else MISSING)
        if summary.baseline is not None:
            cells += _overall_pair(row)
        rows.append(tuple(cells))
    title, _ = metric_title(summary.metrics[0])
    notes = [f"Ranks by {title} within each condition, place and seed; 1 is best, failed cells share the last rank."]
    if summary.baseline is not None:
        notes.append("p over conditions: each counts once, by the median of its seeds.")
    return Table(tuple(columns), tuple(rows), tuple(notes))


def _improvement(summary: BenchSummary) -> Table:
    """Return how probable it is that the method of a row is better than that of a column, of the best methods."""
    ranked = sorted(summary.overall, key=lambda row: (row.rank is None, row.rank))[:_MOST_COMPARED]
    names = [row.method for row in ranked]
    known = {(one.method, one.other): one for one in summary.improvements}
    rows = []
    for name in names:
        cells = [known.get((name, other)) for other in names]
        rows.append((name, *(MISSING if cell is None else f"{cell.probability:.2f}" for cell in cells)))
    title, _ = metric_title(summary.metrics[0])
    notes = [
        f"Probability that the method of the row has the better {title} than that of the column, on the same frames; a"
        " tie counts half, each condition once. Intervals stand in the JSON."
    ]
    if len(summary.overall) > len(names):
        notes.append(f"The {len(names)} best by rank; the JSON has all.")
    columns = (Column("better than", is_number=False), *(Column(name) for name in names))
    return Table(columns, tuple(rows), tuple(notes))


def _overall_pair(row: Overall) -> list[str]:
    if not row.n_conditions:
        return [MISSING] * 3
    return [significant(row.ratio), str(row.n_conditions), _p_text(row.p)]


def _p_text(p: float | None) -> str:
    if p is None:
        return MISSING
    return "<0.0001" if p < 1e-4 else f"{p:.2g}"


def _in_order(summary: BenchSummary) -> list[MethodResult]:
    """Return the entries of which something has run; the others are counted below the tables."""
    conditions = {condition: place for place, condition in enumerate(summary.conditions)}
    methods = {method: place for place, method in enumerate(summary.methods)}
    found = [entry for entry in summary.entries.values() if entry.n_ok + entry.n_failed]
    return sorted(found, key=lambda entry: (conditions[entry.condition], methods[entry.method]))
