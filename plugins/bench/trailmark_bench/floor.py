"""The baseline of every table: the figures of a robot that never moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from trailmark.evaluation.naming import quantity_of
from trailmark_bench.entries import MethodResult, entries_of_groups
from trailmark_bench.index import CellRecord
from trailmark_bench.naming import Namer
from trailmark_bench.quantities import Metric
from trailmark_bench.sampling import trial_of

__all__ = ["FLOOR", "floor_entries"]

#: The method's name in tables.
FLOOR = "stands_still"


def floor_entries(
    records: Sequence[CellRecord], metrics: Sequence[Metric], namer: Namer
) -> Mapping[tuple[str, str], MethodResult]:
    """Return the entries of the robot that never moves, by method and condition.

    Every cell with ground truth says its errors, whatever the localizer; one cell of each place and seed is enough. It
    is ranked and compared with nobody, and has no share of what it tracked: it claims nothing.
    """
    errors = {metric.name for metric in metrics if metric.spec.needs == "truth"}
    groups: dict[tuple[str, str], dict[object, CellRecord]] = {}
    for record in records:
        told = record.result.get("floor", {}) if record.state == "ok" else {}
        known = {key: value for key, value in told.items() if quantity_of(key) in errors}
        if known:
            still = replace(record, result={"metrics": known, "alignment": "origin", "errors": True})
            groups.setdefault((FLOOR, namer.condition(record)), {}).setdefault(trial_of(record), still)
    return entries_of_groups({key: list(found.values()) for key, found in groups.items()}, metrics)
