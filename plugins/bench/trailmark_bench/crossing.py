"""A matrix: every value of every axis with every other, as cells with their addresses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

from trailmark.config.document import Problems
from trailmark.errors import ConfigError
from trailmark.isolation.fingerprint import digest_of, without_paths
from trailmark_bench.axes import AxisReader, AxisValue
from trailmark_bench.cell import Cell
from trailmark_bench.choice import Only, exclusions, is_excluded
from trailmark_bench.combination import Combination, Combiner
from trailmark_bench.config import AXES
from trailmark_bench.context import MatrixContext
from trailmark_bench.overlay import overlaid

__all__ = ["FORMAT", "Matrix"]

#: Changes of what a cell means or how it is measured: older results then have other addresses.
FORMAT = 1

_HEX = 20


class Matrix:
    """One matrix of a bench.

    Parameters
    ----------
    context : MatrixContext
        The matrix as it is written, and what cells are made with.
    shared : mapping
        The run config that all matrices share.
    """

    def __init__(self, context: MatrixContext, shared: Mapping[str, Any]) -> None:
        self._context = context
        self._section = context.section
        self._matrix = context.matrix
        self._base = overlaid(shared, context.matrix.config)
        self._combiner = Combiner(context, self._base)
        self.notices: list[str] = []

    def cells(self, only: Only) -> list[Cell]:
        """Return the cells that are asked for."""
        problems = Problems(self._context.document)
        reader = AxisReader(self._context, problems)
        axes = [values for axis in AXES if (values := reader.values(axis))]
        self.notices += reader.notices
        problems.raise_if_any()
        known: dict[str, Sequence[str]] = {AXES[found[0].axis]: [value.name for value in found] for found in axes}
        known["seed"] = [str(seed) for seed in self._seeds()]
        rules = exclusions(self._context, known, problems)
        problems.raise_if_any()
        cells: list[Cell] = []
        for combination in product(*axes):
            values = list(combination)
            coordinates = {AXES[value.axis]: value.name for value in values}
            seeds = [
                seed
                for seed in self._seeds()
                if not is_excluded(rules, {**coordinates, "seed": seed})
                and only.keeps(self._matrix.name, {**coordinates, "seed": seed})
            ]
            if seeds:
                cells += self._of(values, coordinates, seeds)
        return cells

    def _seeds(self) -> tuple[int, ...]:
        seeds = self._matrix.seeds
        first = int(self._base.get("seed") or 0)
        return tuple(range(first, first + seeds)) if isinstance(seeds, int) else seeds

    def _of(self, values: Sequence[AxisValue], coordinates: Mapping[str, Any], seeds: Sequence[int]) -> list[Cell]:
        missing = next((value.missing for value in values if value.missing), "")
        if missing:
            return [self._missing_cell(coordinates, seed, missing) for seed in seeds]
        is_installed = any(value.is_installed for value in values)
        try:
            combination = self._combiner.combine(values)
        except ConfigError as error:
            if not is_installed:
                raise
            named = ", ".join(str(name) for name in coordinates.values())
            self.notices.append(f"'{named}' is left out: {str(error).splitlines()[0]}")  # nobody asked for it
            return []
        address = self._address_of(combination)
        return [self._cell(combination, address, {**coordinates, "seed": seed}, is_installed) for seed in seeds]

    def _address_of(self, combination: Combination) -> dict[str, Any]:
        """Return what a result depends on but for the seed, which stands in the run and in the teaching."""
        judging = self._judging()
        return {
            "format": FORMAT,
            "run": _run_address(combination.document, combination.data),
            "teach": None if combination.teach is None else _run_address(combination.teach, combination.data),
            "code": combination.code,
            "judging": judging | {"subject": _subject(combination, judging)},
            "threads": combination.limits["threads"],
        }

    def _judging(self) -> dict[str, Any]:
        return (self._matrix.judging or self._section.judging).model_dump(mode="json")

    def _cell(
        self, combination: Combination, address: Mapping[str, Any], coordinates: dict[str, Any], is_installed: bool
    ) -> Cell:
        seeded, judging = {"seed": coordinates["seed"]}, self._judging()
        teach = None if combination.teach is None else combination.teach | seeded
        runs = {key: address[key] and address[key] | seeded for key in ("run", "teach")}
        cell_id = digest_of({**address, **runs})[:_HEX]
        request = {
            "id": cell_id,
            "coordinates": coordinates,
            "document": combination.document | seeded,
            "teach": teach,
            "base_dir": str(self._context.document.base_dir.absolute()),
            "subject": _subject(combination, judging),
            "localizer": combination.first_localizer,
            "align": judging["align"],
            "code": combination.code,
            "data": combination.data,
            "limits": combination.limits,
            "keep_stores": self._section.keep_stores,
            **self._context.session,
        }
        return Cell(cell_id, self._matrix.name, coordinates, request, self._matrix.alone, is_installed=is_installed)

    def _missing_cell(self, coordinates: Mapping[str, Any], seed: int, missing: str) -> Cell:
        named = {**coordinates, "seed": seed}
        return Cell(
            digest_of({"missing": missing, "matrix": self._matrix.name, "cell": named})[:_HEX],
            self._matrix.name,
            named,
            {},
            missing=missing,
        )


def _subject(combination: Combination, judging: Mapping[str, Any]) -> str:
    """Return whose way is judged."""
    return combination.first_localizer if judging["trajectory"] == "localizer" else "fused"


def _run_address(document: Mapping[str, Any], data: Mapping[str, str]) -> Any:
    """Return what of a config a result depends on."""
    kept = {key: value for key, value in document.items() if key not in ("sinks", "plugins")}
    store = kept.get("path_store")
    if isinstance(store, Mapping):
        kept["path_store"] = {key: value for key, value in store.items() if key != "path"}
    return without_paths(kept, lambda path: data[path])
