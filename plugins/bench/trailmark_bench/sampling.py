"""What counts as a sample: the places of a condition, and the seeds within each; seeds that change nothing are one."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from trailmark_bench.cell import UNSUCCESSFUL
from trailmark_bench.index import CellRecord

__all__ = ["Trial", "fixed_places", "samples_by_place", "trial_of"]

#: Place and seed of a cell: methods are compared on equal ones.
Trial = tuple[str, Any]


def trial_of(record: CellRecord) -> Trial:
    """Return place and seed of a cell."""
    return str(record.coordinates.get("place", "")), record.coordinates.get("seed", 0)


def fixed_places(records: Sequence[CellRecord]) -> frozenset[str]:
    """Return the places in which one method under one condition gave the same figures with each of several seeds.

    Its recording and everything that works on it is deterministic there: to run it again tells nothing new. Where a
    cell failed nothing is said: a failure that comes and goes is no constant.
    """
    figures: dict[str, list[str]] = {}
    for record in records:
        place, _ = trial_of(record)
        if record.state in UNSUCCESSFUL:
            figures.setdefault(place, []).extend(["", record.id])  # never the same
        elif record.state == "ok":
            figures.setdefault(place, []).append(json.dumps(record.result.get("metrics", {}), sort_keys=True))
    return frozenset(place for place, found in figures.items() if len(found) > 1 and len(set(found)) == 1)


def samples_by_place(values: Mapping[Trial, float], fixed: frozenset[str]) -> list[list[float]]:
    """Return the values of each place; one of each place whose seeds change nothing."""
    places: dict[str, list[float]] = {}
    for (place, _), value in values.items():
        found = places.setdefault(place, [])
        if not (found and place in fixed):
            found.append(value)
    return list(places.values())
