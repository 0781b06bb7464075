"""The tables of a run, as text in cells: the terminal and the page show the same ones."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from trailmark.evaluation import GROUND_TRUTH, OUTCOMES, QUANTITIES, find_metric, quantities_of, spec_of
from trailmark.metrics import MetricSpec
from trailmark.report.columns import Cells, Column, metric_columns, number_column
from trailmark.report.numbers import MISSING, count_text, significant

__all__ = [
    "Column",
    "Table",
    "Trajectories",
    "consistency_table",
    "offsets_table",
    "sources_table",
    "starting_table",
    "timing_table",
    "trajectories_table",
]

Document = Mapping[str, Any]
Sources = Sequence[tuple[tuple[str, ...], Document]]


@dataclass(frozen=True, slots=True)
class Table:
    """A table of text.

    Attributes
    ----------
    columns : tuple of Column
    rows : tuple of tuple of str
        A text for each column.
    notes : tuple of str
        What the reader has to know, a sentence each.
    title : str
        Stands above it on a terminal; empty: nothing does.
    """

    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()
    title: str = ""


@dataclass(frozen=True, slots=True)
class Trajectories:
    """Trajectory documents of ``metrics.json`` to be shown in one table.

    Attributes
    ----------
    labels : tuple of tuple of str
        The first cells of each row.
    documents : tuple of mapping
        One for each row.
    errors : bool
        Whether the numbers are errors against ground truth, or differences.
    reference : str
        What the differences are from.
    quantities : tuple of MetricSpec
        What may have a column, in their order.
    """

    labels: tuple[tuple[str, ...], ...]
    documents: tuple[Document, ...]
    errors: bool
    reference: str = ""
    quantities: tuple[MetricSpec, ...] = QUANTITIES

    @classmethod
    def of_runs(cls, runs: Sequence[tuple[tuple[str, ...], Document]]) -> Trajectories:
        """Return the trajectories of runs that have the truth, or of one that has not, each with the labels of its run.

        Not the ground truth, which has nothing to be compared with. What is known of a localizer's estimates stands
        beside what is known of its trajectory.
        """
        found = [row for labels, document in runs for row in _rows_of(labels, document)]
        first, documents = runs[0][1], [document for _, document in runs]
        return cls(
            tuple(labels for labels, _ in found),
            tuple(item for _, item in found),
            first["errors"],
            first["reference"] or "",
            quantities_of(documents),
        )

    @classmethod
    def of_run(cls, document: Document) -> Trajectories:
        """Return the trajectories of one run."""
        return cls.of_runs([((), document)])

    def shown_quantities(self) -> list[MetricSpec]:
        """Return what has a column: errors, or the differences that stand for them."""
        known = [spec if self.errors else spec.as_difference() for spec in self.quantities]
        return [spec for spec in known if spec is not None and spec.title]


def trajectories_table(trajectories: Trajectories, label_titles: Sequence[str] = ("trajectory",)) -> Table:
    """Return a row of metrics for each trajectory; columns without any number are left out."""
    documents = trajectories.documents
    columns: list[tuple[Column, list[str]]] = [
        (Column("poses"), [count_text(item["poses"]) for item in documents]),
        *metric_columns(documents, trajectories.shown_quantities(), _marks(documents)),
    ]
    shown = [(column, cells) for column, cells in columns if any(cell.strip() != MISSING for cell in cells)]
    table = _assemble_table(label_titles, trajectories.labels, shown)
    title = "" if trajectories.errors or not trajectories.reference else f"Differences from {trajectories.reference}"
    return replace(table, notes=tuple(_notes(trajectories)), title=title)


def offsets_table(sources: Sources, label_titles: Sequence[str] = ("localizer",)) -> Table | None:
    """Return the errors of path offsets: station, offset, heading; None without path offsets."""
    known = [(label, item) for label, item in sources if any(_offset(item, *what) is not None for what in _OFFSETS)]
    if not known:
        return None
    items = [item for _, item in known]
    errors = any(find_metric(item["metrics"], "offset_lateral_rmse_m") is not None for item in items)
    quantities = [MetricSpec(_offset_name(items, word, unit), unit, title=title) for word, unit, title in _OFFSETS]
    shares = [spec_of(name, _SHARES) for name in ("answered_fraction", "silent")]
    columns = [column for column in metric_columns(items, [*quantities, *shares]) if _has_number(column)]
    table = _assemble_table(label_titles, [label for label, _ in known], columns)
    return replace(
        table, title="Path offsets against the ground truth" if errors else "Path offsets against the belief"
    )


def sources_table(sources: Sources, label_titles: Sequence[str] = ("localizer",)) -> Table:
    """Return a row for each localizer: what became of its estimates, and how old they were on arrival."""
    outcomes = [outcome for outcome in OUTCOMES if any(outcome in item["outcomes"] for _, item in sources)]
    columns: list[tuple[Column, list[str]]] = [
        (Column("estimates"), [count_text(item["estimates"]) for _, item in sources]),
        *((Column(word), [count_text(item["outcomes"].get(word, 0)) for _, item in sources]) for word in outcomes),
    ]
    for word in ("p50", "p95", "max"):
        latencies = [(item["latency"] or {}).get(f"{word}_ms") for _, item in sources]
        columns.append(number_column(f"age {word}", "ms", latencies))
    return _assemble_table(label_titles, [label for label, _ in sources], columns)


def consistency_table(sources: Sources, label_titles: Sequence[str] = ("localizer",)) -> Table | None:
    """Return what NIS and NEES say of each localizer that has one; None where none has."""
    known = [(label, item) for label, item in sources if item["nis"] or item["nees"]]
    if not known:
        return None
    columns = [
        column
        for word in ("nis", "nees")
        if any(item[word] for _, item in known)
        for column in _consistency_columns(word, [item[word] for _, item in known])
    ]
    table = _assemble_table(label_titles, [label for label, _ in known], columns)
    return replace(table, notes=tuple(_consistency_notes(known)))


def _assemble_table(
    label_titles: Sequence[str], labels: Sequence[Sequence[str]], columns: Sequence[tuple[Column, list[str]]]
) -> Table:
    titles = [Column(title, is_number=False) for title in label_titles]
    rows = zip(*(cells for _, cells in columns), strict=True) if columns else [()] * len(labels)
    return Table(
        (*titles, *(column for column, _ in columns)),
        tuple((*label, *row) for label, row in zip(labels, rows, strict=True)),
    )


def timing_table(stages: Mapping[str, Mapping[str, float]]) -> Table:
    """Return a row for each stage of ``timing.json`` that takes part in the loop."""
    words = ("mean", "p50", "p95", "p99", "max")
    rows = [
        (name, count_text(int(stage.get("n", 0))), *(significant(stage.get(f"{word}_ms")) for word in words))
        for name, stage in stages.items()
        if not name.startswith(_STARTING) and _is_timed(stage)
    ]
    slowest = {"max": "The slowest call."}
    times = (Column(word, "ms", meaning=slowest.get(word, "")) for word in words)
    columns = (Column("stage", is_number=False), Column("calls"), *times)
    return Table(columns, tuple(rows))


def starting_table(stages: Mapping[str, Mapping[str, float]]) -> Table | None:
    """Return how long each part took to start, the slowest first; None where that was not measured."""
    took = {name[len(_STARTING) :]: stage for name, stage in stages.items() if name.startswith(_STARTING)}
    slowest = sorted(took, key=lambda name: -float(took[name].get("max_ms", 0.0)))
    rows = [(name, significant(took[name].get("max_ms"))) for name in slowest]
    return Table((Column("part", is_number=False), Column("took", "ms")), tuple(rows)) if rows else None


#: What to do about it, and what the figure holds besides.
_TOO_SURE = (
    "What an overconfident localizer should state is measured by 'trailmark evaluate --noise', as lines for the config."
    " Against the truth, places in a taught map have the error of their teaching, too, and single motions of a camera"
    " an error that the next one takes back."
)
#: Stages of ``timing.json`` that are over when the loop begins.
_STARTING = "start."
_OFFSETS = (("along", "m", "along rmse"), ("lateral", "m", "lateral rmse"), ("heading", "deg", "heading rmse"))
_SHARES = (MetricSpec("answered_fraction", "share", title="answered"), MetricSpec("silent", "share", title="silent"))


def _offset_name(items: Sequence[Document], word: str, unit: str) -> str:
    names = (f"offset_{word}_rmse_{unit}", f"offset_{word}_difference_rmse_{unit}")
    return next((name for name in names if any(find_metric(i["metrics"], name) is not None for i in items)), names[0])


def _offset(item: Document, word: str, unit: str, _title: str) -> float | None:
    return find_metric(item["metrics"], _offset_name([item], word, unit))


def _has_number(column: Cells) -> bool:
    return any(cell.strip() != MISSING for cell in column[1])


def _rows_of(labels: tuple[str, ...], document: Document) -> Iterator[tuple[tuple[str, ...], Document]]:
    """Yield the trajectories of a run; last what a robot would have that never moved.

    A localizer of path offsets alone has no way of its own: `offsets_table` tells what it is worth.
    """
    for name, item in document["trajectories"].items():
        source = document["sources"].get(name, {})
        if name != GROUND_TRUTH and source.get("says_places", True):
            lost = {"lost_reasons": source.get("lost_reasons") or {}, "truth": document.get("truth", "")}
            yield (*labels, name), item | lost | {"metrics": item["metrics"] | _source_metrics(document, name)}
    if still := document.get("stands_still"):
        yield (*labels, "standstill"), still


def _source_metrics(document: Document, name: str) -> Document:
    metrics: Document = document["sources"].get(name, {}).get("metrics", {})
    return metrics


def _marks(documents: Sequence[Document]) -> list[str]:
    """Return a star for each that was aligned otherwise than asked, two for those of a second reason, and so on."""
    stars = {reason: "*" * (k + 1) for k, reason in enumerate(_reasons(documents))}
    marks = [stars[item["alignment"]["reason"]] if _fell_back(item) else "" for item in documents]
    return [mark.ljust(len(stars)) for mark in marks]  # digits stay below digits


def _reasons(documents: Sequence[Document]) -> list[str]:
    """Return why some were aligned otherwise than asked, each once."""
    return sorted({item["alignment"]["reason"] for item in documents if _fell_back(item)})


def _fell_back(document: Document) -> bool:
    alignment = document.get("alignment")
    return alignment is not None and alignment["asked"] != alignment["used"]


def _notes(trajectories: Trajectories) -> list[str]:
    compared = [item for item in trajectories.documents if "alignment" in item and not item.get("is_floor")]
    notes = sorted({f"{item['truth']}." for item in trajectories.documents if item.get("truth")})
    if not trajectories.errors and trajectories.reference:
        notes.append(f"No ground truth: the numbers are differences from {trajectories.reference}, not errors.")
    if compared:
        notes.append(_alignment_note(compared))
    reasons = _reasons(trajectories.documents)
    notes += [f"{'*' * (k + 1)} aligned at the origin: {reason}." for k, reason in enumerate(reasons)]
    for label, item in zip(trajectories.labels, trajectories.documents, strict=True):
        if "problem" in item:
            notes.append(f"{' '.join(label)}: {item['problem']}.")
        if lost := item.get("lost_reasons"):
            told = ", ".join(f"{count} x {reason}" for reason, count in lost.items())
            notes.append(f"{' '.join(label)} was lost: {told}.")
    return notes


def _alignment_note(compared: Sequence[Document]) -> str:
    asked = ", ".join(sorted({item["alignment"]["asked"] for item in compared}))
    pairs = [item["association"]["pairs"] for item in compared]
    several = (
        f"{count_text(min(pairs))} to {count_text(max(pairs))}" if min(pairs) < max(pairs) else count_text(pairs[0])
    )
    return f"Alignment: {asked}, over {several} pairs of poses."


def _consistency_columns(word: str, items: Sequence[Document | None]) -> list[tuple[Column, list[str]]]:
    interval = [MISSING if item is None else f"{item['lower']:.2f} to {item['upper']:.2f}" for item in items]
    return [
        (Column(f"{word.upper()} of"), [MISSING if item is None else count_text(item["n"]) for item in items]),
        (Column(f"{word.upper()}/dof"), [significant(None if item is None else item["per_dof"]) for item in items]),
        (Column("expected"), interval),
    ]


def _consistency_notes(sources: Sources) -> list[str]:
    notes = []
    for label, item in sources:
        for word, against in (("nis", "the belief"), ("nees", "the ground truth")):
            found = item[word]
            # what leads the belief differs little from it, and is no less sure for that
            leads = word == "nis" and found and found["verdict"] == "underconfident"
            if found and found["verdict"] != "consistent" and not leads:
                size = "more" if found["verdict"] == "overconfident" else "less"
                notes.append(
                    f"{' '.join(label)} is {found['verdict']} against {against}: its estimates differ by {size}"
                    f" than their covariances say ({word.upper()}/dof {significant(found['per_dof'])}, 1 expected)."
                )
    if any(item["nees"] and item["nees"]["verdict"] == "overconfident" for _, item in sources):
        notes.append(_TOO_SURE)
    return notes


def _is_timed(stage: object) -> bool:
    """Return whether a stage of ``timing.json`` has the form in which it was written."""
    return isinstance(stage, Mapping) and all(
        isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        for value in stage.values()
    )
