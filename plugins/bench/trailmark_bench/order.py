"""The order in which cells run, so that a bench that is ended early shows most; which cells are a quick pass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from trailmark.isolation.fingerprint import digest_of
from trailmark_bench.cell import Cell

__all__ = ["first_samples", "frames_of", "in_order_of_worth", "without_faults"]

#: What a perturbation that changes nothing is called.
_CLEAN = "clean"
#: Axes whose values are samples of one condition, those that matter more first.
_SAMPLES = ("seed", "place")


def in_order_of_worth(cells: Sequence[Cell], bench: Sequence[Cell] | None = None) -> list[Cell]:
    """Return cells so that every condition has a figure before any has a second: places before seeds.

    Within one round what has no fault comes first; cells of one source, place, seed and fault stand together, so that
    they find its frames rendered.

    Parameters
    ----------
    cells : sequence of Cell
        Those to sort.
    bench : sequence of Cell, optional
        All cells of their bench, where they are what is left of it: which place and seed is the first is seen there.
    """
    ranks = _Ranks(cells if bench is None else bench)

    def worth(cell: Cell) -> tuple[int, int, bool]:
        perturbation = cell.coordinates.get("perturbation", _CLEAN)
        return *ranks.of(cell), perturbation != _CLEAN

    return sorted(cells, key=worth)  # stable: otherwise as the matrices have them


def first_samples(cells: Sequence[Cell]) -> list[Cell]:
    """Return the cells of the first seed and place that each combination of the other axes has."""
    ranks = _Ranks(cells)
    firsts: dict[object, tuple[int, int]] = {}
    for cell in cells:
        combination = _combination(cell)
        firsts[combination] = min(firsts.get(combination, ranks.of(cell)), ranks.of(cell))
    return [cell for cell in cells if ranks.of(cell) == firsts[_combination(cell)]]


def frames_of(cell: Cell) -> str | None:
    """Return what cells have in common that may see the same frames but for faults; None where nothing is known."""
    document = cell.request.get("document")
    if document is None:
        return None
    sources = {name: without_faults(source) for name, source in document["sources"].items()}
    return digest_of({"sources": sources, "seed": document.get("seed")})


def without_faults(source: Mapping[str, Any]) -> dict[str, Any]:
    """Return the section of a source as if nothing were wrong with it."""
    return {key: value for key, value in source.items() if key != "perturb"}


def _combination(cell: Cell) -> tuple[str, frozenset[tuple[str, object]]]:
    """Return a cell's matrix and its coordinates but for place and seed."""
    return cell.matrix, frozenset(item for item in cell.coordinates.items() if item[0] not in _SAMPLES)


class _Ranks:
    """How many values of an axis a matrix has before a cell's own."""

    def __init__(self, cells: Sequence[Cell]) -> None:
        self._known: dict[tuple[str, str], dict[object, int]] = {}
        for cell in cells:
            for axis in _SAMPLES:
                values = self._known.setdefault((cell.matrix, axis), {})
                values.setdefault(cell.coordinates.get(axis), len(values))

    def of(self, cell: Cell) -> tuple[int, int]:
        """Return the rank of its seed, and of its place."""
        seed, place = (self._known[cell.matrix, axis][cell.coordinates.get(axis)] for axis in _SAMPLES)
        return seed, place
