"""How long cells take, from those like them that have run."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from trailmark_bench.cell import Cell
from trailmark_bench.index import CellRecord

__all__ = ["CellDurations", "estimated_s"]


def estimated_s(cells: Iterable[Cell], records: Sequence[CellRecord]) -> list[float | None]:
    """Return how long each cell will take, from those like it that have run; None: nothing is known [s]."""
    durations = CellDurations(records)
    return [durations.estimate_s(cell) for cell in cells]


class CellDurations:
    """Durations of cells: the median of those that differ in the seed alone, in the localizer too, or of all.

    Parameters
    ----------
    records : sequence of CellRecord
        Cells that have run, and others.
    """

    def __init__(self, records: Sequence[CellRecord]) -> None:
        self._known: dict[tuple[Any, ...], list[float]] = {}
        for record in records:
            if record.state == "ok" and record.wall_s is not None:
                self.add(record, record.wall_s)

    def add(self, cell: Cell | CellRecord, wall_s: float) -> None:
        """Take note of how long a cell took [s]."""
        for key in _kinds(cell.coordinates):
            self._known.setdefault(key, []).append(wall_s)

    def estimate_s(self, cell: Cell) -> float | None:
        """Return how long a cell will take; None: nothing is known [s]."""
        known = next((found for key in _kinds(cell.coordinates) if (found := self._known.get(key))), None)
        return None if known is None else statistics.median(known)

    def sum_s(self, cells: Iterable[Cell]) -> float | None:
        """Return how long cells will take one after the other; None: of one of them nothing is known [s]."""
        total_s = 0.0
        for cell in cells:
            estimate_s = self.estimate_s(cell)
            if estimate_s is None:
                return None
            total_s += estimate_s
        return total_s


def _kinds(coordinates: Mapping[str, Any]) -> list[tuple[Any, ...]]:
    """Return what a cell is like, from the most alike on."""
    unseeded = {axis: value for axis, value in coordinates.items() if axis != "seed"}
    where = {axis: value for axis, value in unseeded.items() if axis in ("source", "localizer")}
    return [tuple(unseeded.items()), tuple(where.items()), (coordinates.get("source"),), ()]
