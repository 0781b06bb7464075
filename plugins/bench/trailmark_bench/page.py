"""The report of a bench: one page that stands alone, with a page for each cell inside it."""

from __future__ import annotations

import base64
import json
import logging
import math
import zlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

from trailmark.errors import DataError
from trailmark.report.html import facts_html, folded_meanings_html, page_html, table_html, text_html
from trailmark.report.tables import Table
from trailmark_bench.cell import Cell
from trailmark_bench.index import CellRecord, Index
from trailmark_bench.meanings import MEANINGS, explained
from trailmark_bench.naming import Namer
from trailmark_bench.order import first_samples
from trailmark_bench.quantities import Metric
from trailmark_bench.summary import BenchSummary, summarize_bench
from trailmark_bench.tables import bench_tables, metric_title, scaled_column
from trailmark_bench.winners import winners_table

__all__ = ["PAGE_FILE", "write_page", "write_site"]

logger = logging.getLogger(__name__)

PAGE_FILE = "report.html"

_CHUNK = 64
_LOG_LINES = 60
# What of the provenance differs from cell to cell and is told there.
_ABOUT = ("trailmark", "command", "started", "python", "platform", "cpu", "git", "packages")


def write_page(index: Index, *, baseline: str | None = None) -> Path:
    """Write ``report.html`` into the folder of a bench and return its path; see `write_site`.

    Raises
    ------
    DataError
        If it cannot be written.
    """
    summary = summarize_bench(index, baseline=baseline)
    return _write(_page(index, summary, list(_chunks(index, _Packed()))), index.folder / PAGE_FILE)


def write_site(index: Index, folder: Path, *, baseline: str | None = None, most_mb: float = 5.0) -> Path:
    """Write the page of a bench as ``index.html`` of a folder that can be put on the web, and return its path.

    Nothing is fetched from anywhere: data, script and styles are inside. The pictures of each cell are drawn by the
    page when it is opened, from a few hundred numbers kept with the cell: of all cells if there is room, else of one
    place and seed of each combination, else of none; then the logs of cells that failed are left out too. Where the
    tables alone are larger, a warning says so.

    Parameters
    ----------
    index : Index
        Of the bench.
    folder : Path
        It is made where it is not there.
    baseline : str, optional
        The method compared with, in place of that of the config.
    most_mb : float
        Size of the page [MB].

    Raises
    ------
    DataError
        If it cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    records = [record for record in index.records() if record.state == "ok"]
    cells = [Cell(record.id, record.matrix, record.coordinates, {}) for record in records]
    summary = summarize_bench(index, baseline=baseline)
    firsts = {cell.id for cell in first_samples(cells)}
    page, size_mb = "", math.inf
    for packed in (_Packed(), _Packed(firsts), _Packed(set()), _Packed(set(), logs=False)):
        page = _page(index, summary, list(_chunks(index, packed)))
        size_mb = len(page.encode("utf-8", "replace")) / 1e6
        if size_mb <= most_mb:
            break
    else:
        logger.warning("the page has %.3g MB, more than %g, without any picture or log", size_mb, most_mb)
    return _write(page, folder / "index.html")


@dataclass(frozen=True)
class _Packed:
    """What a page holds of its cells: the pictures of these (None: of all) that gave a result, and logs."""

    pictured: Collection[str] | None = None
    logs: bool = True


def _page(index: Index, summary: BenchSummary, chunks: Sequence[tuple[list[str], str]]) -> str:
    """Return the page of a bench, with what is packed of its cells."""
    records, meta = index.records(), index.meta()
    places = {cell_id: number for number, (ids, _) in enumerate(chunks) for cell_id in ids}
    document, tables = _document(summary, records, places), bench_tables(summary)
    body = [
        _header(summary, meta),
        _winners(summary),
        _overview(),
        _beside_section(),
        _statistics(tables),
        _cells_section(),
        _tables(summary, tables),
        _provenance(meta),
        "</main>",
        '<main id="cell" hidden></main>',
        f'<script type="application/json" id="data">{_json_html(document)}</script>',
        *(f'<script type="text/plain" id="chunk-{n}">{text}</script>' for n, (_, text) in enumerate(chunks)),
    ]
    own = files("trailmark_bench")
    style, script = (own.joinpath(name).read_text(encoding="utf-8") for name in ("page.css", "page.js"))
    return page_html(f"{summary.name}, a Trailmark bench", body, style=style, script=script)


def _write(page: str, path: Path) -> Path:
    try:
        path.unlink(missing_ok=True)  # never through a link of a stranger's folder
        path.write_text(page, encoding="utf-8", errors="replace")  # a path in it may be no text
    except OSError as error:
        raise DataError(f"cannot write {path}: {error.strerror or error}") from error
    return path


def _chunks(index: Index, packed: _Packed) -> Iterator[tuple[list[str], str]]:
    """Yield ids of cells of which something is packed, and a line for each: id, packed detail, packed end of the log.

    Cells that gave a result and are not pictured are left out, their logs too.
    """
    good = set() if packed.pictured is None else {record.id for record in index.records() if record.state == "ok"}
    left_out = good - set(packed.pictured or ())
    ids: list[str] = []
    lines: list[str] = []
    for cell_id, detail, stderr in index.details():
        tail = "\n".join(stderr.splitlines()[-_LOG_LINES:]) if packed.logs else ""
        if (detail is None and not tail) or cell_id in left_out:
            continue
        ids.append(cell_id)
        log = zlib.compress(json.dumps(tail).encode()) if tail else b""
        lines.append(f"{cell_id} {_base64(detail or b'')} {_base64(log)}")
        if len(ids) == _CHUNK:
            yield ids, "\n".join(lines)
            ids, lines = [], []
    if ids:
        yield ids, "\n".join(lines)


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode()


def _document(summary: BenchSummary, records: list[CellRecord], places: Mapping[str, int]) -> dict[str, Any]:
    axes = list(dict.fromkeys(axis for record in records for axis in record.coordinates))
    namer = Namer(records)
    shown = [_Shown.of(metric, summary) for metric in summary.metrics]
    entries = [
        {
            "method": entry.method,
            "condition": entry.condition,
            "ok": entry.n_ok,
            "failed": entry.n_failed,
            "skipped": entry.counts.get("skipped", 0),
            "stats": [one.statistics(told["metrics"][one.metric.name]) for one in shown],
        }
        for entry, told in zip(summary.entries.values(), summary.document()["entries"], strict=True)
    ]
    cells = [
        {**_cell(record, axes, namer), "values": [one.value(record) for one in shown], "chunk": places.get(record.id)}
        for record in records
    ]
    return {
        "name": summary.name,
        "meanings": dict(MEANINGS),
        "baseline": summary.baseline,
        "metrics": [one.document() for one in shown],
        "axes": axes,
        "methods": list(summary.methods),
        "conditions": list(summary.conditions),
        "entries": entries,
        "cells": cells,
    }


@dataclass(frozen=True, slots=True)
class _Shown:
    """A quantity in the unit that suits it: `per_unit` of it make one of its own."""

    metric: Metric
    title: str
    unit: str
    per_unit: float

    @classmethod
    def of(cls, metric: Metric, summary: BenchSummary) -> _Shown:
        medians = [entry.median(metric) for entry in summary.entries.values()]
        column, per_unit = scaled_column(*metric_title(metric), medians)
        return cls(metric, column.title, column.unit, per_unit)

    def document(self) -> dict[str, str]:
        return {"name": self.metric.name, "better": self.metric.better, "title": self.title, "unit": self.unit}

    def value(self, record: CellRecord) -> Any:
        value = self.metric.value_of(record) if record.state == "ok" else None
        return None if value is None else _short(self.per_unit * value)

    def statistics(self, found: Mapping[str, Any] | None) -> dict[str, Any] | None:
        """Return the numbers of a method under a condition; a median that is infinite is said in words."""
        if found is None:
            return None
        sides = {key: found[key] for key in ("median", "q1", "q3", "low", "high")}
        scaled = {key: None if value is None else _short(self.per_unit * value) for key, value in sides.items()}
        median = "failed" if scaled["median"] is None else scaled["median"]
        versus = found.get("versus")
        return {
            **scaled,
            "n": found["n"],
            "median": median,
            "versus": None if versus is None else _shorten(versus),
        }


def _cell(record: CellRecord, axes: list[str], namer: Namer) -> dict[str, Any]:
    process = {key: getattr(record, key) for key in ("attempts", "wall_s", "cpu_s", "peak_rss_mb", "load", "host")}
    return {
        "id": record.id,
        "matrix": record.matrix,
        "at": [record.coordinates.get(axis) for axis in axes],
        "method": namer.method(record),
        "condition": namer.condition(record),
        "state": record.state,
        "reason": record.reason,
        **process,
    }


def _shorten(numbers: Mapping[str, Any]) -> dict[str, Any]:
    return {key: _short(value) for key, value in numbers.items()}


def _short(value: Any) -> Any:
    if not isinstance(value, float):
        return value
    return float(f"{value:.5g}") if math.isfinite(value) else None


def _json_html(document: Any) -> str:
    """Return JSON for use inside a script element: nothing in it ends the element."""
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _header(summary: BenchSummary, meta: Mapping[str, Any]) -> str:
    about = meta.get("provenance", {})
    n_cells = sum(summary.counts.values())
    numbers = {"cell": n_cells, "method": len(summary.methods), "condition": len(summary.conditions)}
    facts = [f"{n} {word}{'' if n == 1 else 's'}" for word, n in numbers.items()]
    facts += [f"compared with {summary.baseline}"] if summary.baseline else []
    facts += [f"started {about['started'][:16].replace('T', ' ')}"] if about.get("started") else []
    line = text_html(", ".join(facts) + ".", css_class="summary")
    title, states = text_html(summary.name, "h1"), '<ul class="chips" id="states"></ul>'
    return f'<main id="bench"><header>\n{title}\n{line}\n{states}</header>'


def _winners(summary: BenchSummary) -> str:
    """Return who wins where, where methods are compared."""
    table = winners_table(summary)
    if not table.rows:
        return ""
    return f'<section id="winners">{text_html("Who wins where", "h2")}{table_html(explained(table))}</section>'


def _overview() -> str:
    controls = '<p class="controls"><label>Quantity <select id="metric"></select></label>'
    controls += '<label id="part-label" hidden>Part <select id="part"></select></label></p>'
    heat = '<div class="scroll"><table class="heat" id="heat"></table></div><p class="note" id="heat-note"></p>'
    return "\n".join([text_html("Overview", "h2"), controls, heat])


def _statistics(tables: list[Table]) -> str:
    statistics = (
        '<div class="scroll"><table id="statistics"></table></div>'
        '<button class="more" id="more-statistics" hidden></button>'
    )
    notes = [f"<p class='note'>{escape(note)}</p>" for table in tables[1:2] for note in table.notes]
    return "\n".join([text_html("Statistics", "h2"), statistics, *notes, folded_meanings_html(MEANINGS)])


def _beside_section() -> str:
    """Return where the page draws the trajectories of the methods under one condition, on one scale."""
    choice = '<p class="controls"><label>Condition <select id="beside-condition"></select></label></p>'
    figures = '<div id="ranking"></div><div id="beside"></div><p class="note" id="beside-note"></p>'
    figures += '<div id="beside-errors"></div>'
    title = text_html("One condition: ranking and trajectories", "h2")
    return f'<section id="beside-section" hidden>{title}{choice}{figures}</section>'


def _cells_section() -> str:
    return "\n".join(
        [
            '<section id="cells-section">',
            text_html("Cells", "h2"),
            '<p class="controls"><input type="search" id="filter" placeholder="filter: words of name, state, reason"'
            ' aria-label="Filter the cells"><button class="chip" id="chosen" hidden></button>'
            '<span class="note" id="count"></span></p>',
            '<div class="scroll"><table id="cells"></table></div>',
            '<button class="more" id="more-cells" hidden></button>',
            "<noscript><p class='warning'>Sorting, filtering and the pages of cells need JavaScript.</p></noscript>",
            "</section>",
        ]
    )


def _tables(summary: BenchSummary, tables: list[Table]) -> str:
    """Return the methods over all conditions, and why cells gave nothing."""
    n_tables = (len(summary.methods) > 1) + bool(summary.improvements)
    parts = [text_html("Methods over all conditions", "h2")] if n_tables else []
    parts += [table_html(explained(table)) for table in tables[len(tables) - n_tables :]]
    if summary.reasons:
        rows = "".join(f"<li>{count} &times; {escape(reason)}</li>" for reason, count in summary.reasons.items())
        parts += [text_html("Why cells gave no result", "h2"), f"<ul>{rows}</ul>"]
    return "\n".join(parts)


def _provenance(meta: Mapping[str, Any]) -> str:
    about = meta.get("provenance", {})
    facts = {key: about[key] for key in _ABOUT if about.get(key)}
    facts |= {"judged by": meta["judging"]} if meta.get("judging") else {}
    return "\n".join([text_html("Provenance", "h2"), facts_html(facts)]) if facts else ""
