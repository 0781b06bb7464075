"""Methods and conditions in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from trailmark_bench.index import CellRecord

__all__ = ["METHOD_AXES", "Namer"]

#: Axes that say what is judged; the others say what it is judged on.
METHOD_AXES = ("localizer", "estimator", "controller", "pipeline")
_CONDITION_AXES = ("source", "perturbation")


class Namer:
    """Names methods and conditions by the axes that differ; where none does, by the first.

    Parameters
    ----------
    records : sequence of CellRecord
        The cells that are to be told apart.
    """

    def __init__(self, records: Sequence[CellRecord]) -> None:
        values: dict[str, set[Any]] = {}
        for record in records:
            for axis, value in {"matrix": record.matrix, **record.coordinates}.items():
                values.setdefault(axis, set()).add(value)
        self._method = _telling(METHOD_AXES, values)
        self._condition = _telling(("matrix", *_CONDITION_AXES), values)

    def method(self, record: CellRecord) -> str:
        return " + ".join(str(record.coordinates[axis]) for axis in self._method if axis in record.coordinates) or "run"

    def condition(self, record: CellRecord) -> str:
        known = {"matrix": record.matrix, **record.coordinates}
        return ", ".join(str(known[axis]) for axis in self._condition if known.get(axis)) or "all"


def _telling(axes: Sequence[str], values: Mapping[str, set[Any]]) -> list[str]:
    several = [axis for axis in axes if len(values.get(axis, ())) > 1]
    return several or [axis for axis in axes if values.get(axis) and axis != "matrix"][:1]
