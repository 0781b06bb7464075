"""The figures of a bench for a paper, a page, or another program."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

from trailmark.report.numbers import MISSING
from trailmark.report.tables import Column, Table
from trailmark_bench.index import Index
from trailmark_bench.summary import BenchSummary, summarize_bench
from trailmark_bench.tables import bench_tables

__all__ = ["export_text", "markdown_of"]

_LATEX = {
    "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "\\": r"\textbackslash{}",
    "°": r"$^\circ$", MISSING: "--", "<": r"$<$", ">": r"$>$",
}  # fmt: skip
_STATISTICS = ("n", "median", "q1", "q3", "low", "high")
_VERSUS = ("n", "difference", "ratio", "wins", "losses", "p", "p_holm")


def export_text(
    index: Index, form: str, metrics: Sequence[str] = (), baseline: str | None = None, cells: bool = False
) -> str:
    """Return the figures of a bench as text.

    Parameters
    ----------
    index : Index
        Of the bench.
    form : {"csv", "latex", "markdown"}
        How: csv with full digits, the others as shown.
    metrics, baseline
        As in `trailmark_bench.summary.summarize_bench`.
    cells : bool
        A row for each cell, in csv.
    """
    if cells:
        return _cells_csv(index)
    summary = summarize_bench(index, metrics, baseline)
    if form == "csv":
        return _statistics_csv(summary)
    write = _latex if form == "latex" else markdown_of
    return "\n".join(write(table) for table in bench_tables(summary)) + _closing(form, summary)


def _statistics_csv(summary: BenchSummary) -> str:
    """Return a row for each condition, method and metric."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    head = ["condition", "method", "metric", "better", "ok", "failed", "skipped", *_STATISTICS]
    writer.writerow([*head, *(f"versus_{name}" for name in _VERSUS)])
    for entry, told in zip(summary.entries.values(), summary.document()["entries"], strict=True):
        for metric in summary.metrics:
            found = told["metrics"][metric.name]
            if found is None:
                continue
            versus = found.get("versus") or {}
            counts = (entry.n_ok, entry.n_failed, entry.counts.get("skipped", 0))
            row = [entry.condition, entry.method, metric.name, metric.better, *counts]
            row += [_plain(found[name]) for name in _STATISTICS]
            writer.writerow([*row, *(_plain(versus.get(name)) for name in _VERSUS)])
    return text.getvalue()


def _cells_csv(index: Index) -> str:
    """Return a row for each cell, a column for each of its figures."""
    records = index.records()
    axes = list(dict.fromkeys(axis for record in records for axis in record.coordinates))
    names = {key: None for record in records for group in ("metrics", "times") for key in record.result.get(group, {})}
    process = ("wall_s", "cpu_s", "peak_rss_mb", "load", "host")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["id", "matrix", *axes, "state", "reason", "attempts", *process, *names])
    for record in records:
        figures = {**record.result.get("metrics", {}), **record.result.get("times", {})}
        row = [record.id, record.matrix, *(record.coordinates.get(axis, "") for axis in axes)]
        row += [record.state, record.reason, record.attempts, *(_plain(getattr(record, name)) for name in process)]
        writer.writerow([*row, *(_plain(figures.get(name)) for name in names)])
    return text.getvalue()


def _plain(value: object) -> object:
    return "" if value is None else repr(value) if isinstance(value, float) else value


def markdown_of(table: Table) -> str:
    """Return a table as Markdown, its notes below it."""

    def row(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"

    rule = ["---:" if column.is_number else "---" for column in table.columns]
    lines = [row([_title(column) for column in table.columns]), row(rule), *(row(cells) for cells in table.rows)]
    return "\n".join([*lines, "", *(f"{note}  " for note in table.notes), ""])


def _latex(table: Table) -> str:
    """Return a tabular for booktabs; the words of the notes stand in comments."""
    kinds = "".join("r" if column.is_number else "l" for column in table.columns)
    titles = " & ".join(_escape(_title(column)) for column in table.columns)
    rows = [" & ".join(_escape(cell) for cell in cells) + r" \\" for cells in table.rows]
    notes = [f"% {note}" for note in table.notes]
    head = [rf"\begin{{tabular}}{{{kinds}}}", r"\toprule", rf"{titles} \\", r"\midrule"]
    return "\n".join([*notes, *head, *rows, r"\bottomrule", r"\end{tabular}", ""])


def _escape(text: str) -> str:
    return "".join(_LATEX.get(letter, letter) for letter in text)


def _title(column: Column) -> str:
    return f"{column.title} [{column.unit}]" if column.unit else column.title


def _closing(form: str, summary: BenchSummary) -> str:
    marks = "% " if form == "latex" else ""
    return "\n" + "\n".join(f"{marks}{line.strip()}" + ("" if marks else "  ") for line in summary.lines()) + "\n"
