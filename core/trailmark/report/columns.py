"""Columns of tables, and those of metrics as they are declared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from trailmark.evaluation import find_metric, quantity_of
from trailmark.metrics import MetricSpec
from trailmark.report.numbers import length_unit, percent_text, significant

__all__ = ["Cells", "Column", "metric_columns", "number_column", "value_of"]

Document = Mapping[str, Any]

_UNITS = {"deg": "°", "deg/m": "°/m", "share": "%"}


@dataclass(frozen=True, slots=True)
class Column:
    """A column: what it shows and in which unit; numbers stand to the right.

    Attributes
    ----------
    title : str
        Heads the column.
    unit : str
        Of its numbers; empty for none.
    is_number : bool
        Whether it is aligned to the right.
    meaning : str
        In a sentence, shown on hover; empty: what is known of its title.
    """

    title: str
    unit: str = ""
    is_number: bool = True
    meaning: str = ""


#: A column and its cells.
Cells = tuple[Column, list[str]]


def metric_columns(
    documents: Sequence[Document], quantities: Sequence[MetricSpec], marks: Sequence[str] = ()
) -> list[Cells]:
    """Return a column for each quantity, of trajectory documents of ``metrics.json``.

    All lengths share the unit that suits the first of them: a table that mixes units invites wrong comparisons. The
    marks stand behind the numbers of the first length, which says how well the others are aligned.
    """
    lengths = [spec for spec in quantities if spec.unit == "m" and _is_known(spec, documents)]
    unit, per_m = length_unit(value_of(item, lengths[0]) for item in documents) if lengths else ("m", 1.0)
    columns = []
    for spec in quantities:
        scale, shown = (per_m, unit) if spec.unit == "m" else (1.0, _UNITS.get(spec.unit, spec.unit))
        title, suffixes = _title(documents, spec)
        if lengths and spec is lengths[0]:
            suffixes = list(marks) or suffixes
        texts = [_text(value_of(item, spec), spec, scale) for item in documents]
        columns.append((Column(title, shown), [text + mark for text, mark in zip(texts, suffixes, strict=True)]))
    return columns


def value_of(document: Document, spec: MetricSpec) -> float | None:
    """Return a trajectory's number of a quantity; None where there is none."""
    if spec.protocol == "distance":
        return _over_a_distance(document, spec.name)[1]
    if spec.protocol == "alignment":
        alignment = document.get("alignment")
        return None if alignment is None else find_metric(document["metrics"], spec.name, alignment["used"])
    return find_metric(document["metrics"], spec.name)


def _is_known(spec: MetricSpec, documents: Sequence[Document]) -> bool:
    return any(value_of(item, spec) is not None for item in documents)


def number_column(title: str, unit: str, values: Sequence[float | None]) -> Cells:
    """Return a column of plain numbers."""
    return Column(title, unit), [significant(value) for value in values]


def _text(value: float | None, spec: MetricSpec, scale: float) -> str:
    if spec.unit == "share":
        return percent_text(value)
    return significant(None if value is None else scale * value)


def _title(documents: Sequence[Document], spec: MetricSpec) -> tuple[str, list[str]]:
    """Return the column's title, and what stands behind each number: the distance, where there is not one for all."""
    if spec.protocol != "distance":
        return spec.title, [""] * len(documents)
    found = [_over_a_distance(item, spec.name) for item in documents]
    distances = {distance for distance, value in found if value is not None}
    if len(distances) == 1:
        (distance,) = distances
        return f"{spec.title} over {distance[:-1]}\u00a0{distance[-1]}", [""] * len(documents)
    return spec.title, [f" /{distance}" if distance else "" for distance, _ in found]


def _over_a_distance(document: Document, quantity: str) -> tuple[str, float | None]:
    for name, value in document["metrics"].items():
        distance = name.partition("[")[2].partition(",")[0]
        if quantity_of(name) == quantity and distance.endswith("m"):
            return distance, value
    return "", None
