"""In which order cells run, so that a bench that is ended early has told most; which of them are a quick pass."""

from __future__ import annotations

from collections.abc import Sequence

from trailmark_bench.cell import Cell

__all__ = ["first_samples", "in_order_of_worth"]

#: What a perturbation that changes nothing is called.
_CLEAN = "clean"


def in_order_of_worth(cells: Sequence[Cell]) -> list[Cell]:
    """Return cells so that every condition has a figure before any has a second: places before seeds.

    Within one round what has no fault comes first; cells of one source, place, seed and fault stand together, so that
    they find its frames rendered.
    """
    ranks = _Ranks(cells)

    def worth(cell: Cell) -> tuple[int, int, bool]:
        perturbation = cell.coordinates.get("perturbation", _CLEAN)
        return ranks.of(cell, "seed"), ranks.of(cell, "place"), perturbation != _CLEAN

    return sorted(cells, key=worth)  # stable: otherwise as the matrices have them


def first_samples(cells: Sequence[Cell]) -> list[Cell]:
    """Return the cells of the first place and the first seed of each matrix."""
    ranks = _Ranks(cells)
    return [cell for cell in cells if ranks.of(cell, "seed") == ranks.of(cell, "place") == 0]


class _Ranks:
    """How many values of an axis a matrix has before a cell's own."""

    def __init__(self, cells: Sequence[Cell]) -> None:
        self._known: dict[tuple[str, str], dict[object, int]] = {}
        for cell in cells:
            for axis in ("seed", "place"):
                values = self._known.setdefault((cell.matrix, axis), {})
                values.setdefault(cell.coordinates.get(axis), len(values))

    def of(self, cell: Cell, axis: str) -> int:
        return self._known[cell.matrix, axis][cell.coordinates.get(axis)]
