"""Who wins where: the best method of each condition, and whether the next one can be told apart from it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from trailmark.report.tables import Column, Table
from trailmark_bench.entries import MethodResult
from trailmark_bench.floor import FLOOR
from trailmark_bench.quantities import Metric
from trailmark_bench.summary import BenchSummary
from trailmark_bench.tables import metric_title, scaled_column, value_text

__all__ = ["Winner", "winners_of", "winners_table"]


@dataclass(frozen=True, slots=True, eq=False)
class Winner:
    """The best method of a condition, by the first metric.

    Attributes
    ----------
    condition : str
        In words.
    best : MethodResult
        Of the smallest median, or of the largest where more is better.
    others : tuple of MethodResult
        The rest, the better first.
    equals : tuple of str
        Methods of which the 95 % interval reaches into that of the best, or of either of which there is none.
    """

    condition: str
    best: MethodResult
    others: tuple[MethodResult, ...]
    equals: tuple[str, ...]


def winners_of(summary: BenchSummary) -> list[Winner]:
    """Return the winner of each condition in which two methods at least ran and one gave a result."""
    metric = summary.metrics[0]
    found = []
    for condition in summary.conditions:
        ran = [e for e in summary.entries.values() if e.condition == condition and metric.name in e.spreads]
        ranked = sorted((e for e in ran if e.method != FLOOR), key=lambda entry: _oriented(entry, metric))
        if len(ranked) > 1 and math.isfinite(_oriented(ranked[0], metric)):
            best, *others = ranked
            equals = tuple(other.method for other in others if not _is_apart(best, other, metric))
            found.append(Winner(condition, best, tuple(others), equals))
    return found


def winners_table(summary: BenchSummary) -> Table:
    """Return a row for each condition: who is best, by how much, and who cannot be told apart from it."""
    metric, winners = summary.metrics[0], winners_of(summary)
    shown = [entry.median(metric) for winner in winners for entry in (winner.best, winner.others[0])]
    figure, per_unit = scaled_column(*metric_title(metric), shown)
    columns = (
        Column("condition", is_number=False),
        Column("best", is_number=False),
        figure,
        Column("95 %", figure.unit),
        Column("next", is_number=False),
        figure,
        Column("not told apart", is_number=False),
    )
    rows = [_row(winner, metric, per_unit) for winner in winners]
    notes = (
        "By the median over places and seeds. Not told apart: methods whose 95 % interval reaches into that of the"
        " best, and all where there are too few samples for an interval.",
    )
    return Table(columns, tuple(rows), notes)


def _row(winner: Winner, metric: Metric, per_unit: float) -> tuple[str, ...]:
    best, following = winner.best, winner.others[0]
    spread = best.spreads[metric.name]
    sides = sorted(value for side in (spread.low, spread.high) if (value := best.shown(metric, side)) is not None)
    interval = " to ".join(value_text(value, per_unit) for value in sides) if len(sides) == 2 else value_text(None)
    figures = [value_text(entry.median(metric), per_unit) for entry in (best, following)]
    equals = _in_words(winner.equals)
    return winner.condition, best.method, figures[0], interval, following.method, figures[1], equals


def _in_words(methods: Sequence[str], most: int = 4) -> str:
    more = f" and {len(methods) - most} more" if len(methods) > most else ""
    return ", ".join(methods[:most]) + more


def _oriented(entry: MethodResult, metric: Metric) -> float:
    median = entry.median(metric)
    return math.inf if median is None else metric.oriented(median)


def _is_apart(best: MethodResult, other: MethodResult, metric: Metric) -> bool:
    """Return whether the worse side of the best is better than the better side of another."""
    if not math.isfinite(_oriented(other, metric)):
        return True
    if metric.better == "near one":  # the sides are those of the values, not of how far they are from one
        return False
    ours, theirs = best.spreads[metric.name].high, other.spreads[metric.name].low
    return ours is not None and theirs is not None and ours < theirs
