"""The tables of a run on a terminal, and the rows that end ``trailmark run``."""

from __future__ import annotations

import json
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any, Literal

from trailmark.evaluation import GROUND_TRUTH, evaluate_run, spec_of
from trailmark.evaluation.run_metrics import METRICS_FILE
from trailmark.report.columns import value_of
from trailmark.report.tables import Column, Table, Trajectories, offsets_table, trajectories_table

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table as RichTable

__all__ = ["print_run", "print_table", "run_document", "run_table", "summary_rows", "table_console", "to_rich"]

_WIDTH = 100
_HEADER_WIDTH = 8
_WIDEST = 160

#: Numbers of a row, and the quantities that they are.
_NUMBERS = {
    "tracked": "tracked_fraction",
    "rmse_m": "ate_rmse_m",
    "max_m": "ate_max_m",
    "heading_rmse_deg": "ate_heading_rmse_deg",
    "drift_percent": "drift_percent",
    "end_m": "end_error_m",
}


def summary_rows(folder: str | Path, document: dict[str, Any] | None = None) -> list[dict[str, Any]]:
    """Return a row of plain numbers for each localizer of a run, and for the fused trajectory.

    Parameters
    ----------
    folder : path
        The run.
    document : dict, optional
        What `evaluate_run` gave for it; default: it is called, and writes nothing.

    Returns
    -------
    list of dict
        ``name``, ``poses``, ``tracked`` (share of time), ``errors`` (False: differences from ``reference``),
        ``reference``, ``rmse_m``, ``max_m``, ``heading_rmse_deg``, ``drift_percent``, ``end_m``, ``outcomes``
        (status to count) and ``latency_p95_ms``; None where a number is not known.

    Raises
    ------
    DataError
        If the folder is not that of a run.
    """
    if document is None:
        document = evaluate_run(folder, write=False)
    names = [name for name in document["trajectories"] if name != GROUND_TRUTH]
    names = [*(name for name in document["sources"] if name not in names), *names]
    return [_summary_row(document, name) for name in names]


def _summary_row(document: dict[str, Any], name: str) -> dict[str, Any]:
    trajectory = document["trajectories"].get(name, {"poses": 0, "metrics": {}})
    source = document["sources"].get(name, {"outcomes": {}, "latency": None})
    errors = document["errors"]
    asked = {key: spec_of(name) for key, name in _NUMBERS.items()}
    specs = {key: spec if errors else spec.as_difference() for key, spec in asked.items()}
    return {
        "name": name,
        "poses": trajectory["poses"],
        "errors": errors,
        "reference": document["reference"],
        **{key: None if spec is None else value_of(trajectory, spec) for key, spec in specs.items()},
        "outcomes": source["outcomes"],
        "latency_p95_ms": (source["latency"] or {}).get("p95_ms"),
    }


def run_table(folder: str | Path) -> RichTable:
    """Return the metrics of a run as a table for a terminal: a row for each localizer and the fused trajectory.

    Parameters
    ----------
    folder : str or Path
        Folder of a run that was evaluated.

    Returns
    -------
    RichTable
        For the ``print`` of a rich console.

    Raises
    ------
    DataError
        If the folder is not that of a run.
    """
    document = evaluate_run(folder, write=False)
    return to_rich(trajectories_table(Trajectories.of_run(document), ("localizer",)))


def print_run(folder: str | Path) -> None:
    """Print the table of a run, with its notes."""
    document = run_document(folder)
    print_table(trajectories_table(Trajectories.of_run(document), ("localizer",)))
    offsets = offsets_table([((name,), item) for name, item in document["sources"].items()])
    if offsets is not None:
        print_table(offsets)


def run_document(folder: str | Path) -> dict[str, Any]:
    """Return ``metrics.json`` of a run, with what plugins measured; made anew where the run left none.

    Raises
    ------
    DataError
        If the folder is not that of a run.
    """
    try:
        document = json.loads((Path(folder) / METRICS_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return evaluate_run(folder, write=False)
    return document if isinstance(document, dict) and "warnings" in document else evaluate_run(folder, write=False)


def to_rich(table: Table) -> RichTable:
    """Return a table for a terminal. Names are text: nothing in them is markup."""
    from rich import box
    from rich.table import Table as RichTable
    from rich.text import Text

    shown = RichTable(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False, padding=(0, 0, 0, 1))
    height = max(len(_header(column)) for column in table.columns)
    for column in table.columns:
        lines = _header(column)
        lines[-1:-1] = [""] * (height - len(lines))  # units stand in one line
        justify: Literal["right", "left"] = "right" if column.is_number else "left"
        shown.add_column(Text("\n".join(lines)), justify=justify, no_wrap=column.is_number, overflow="fold")
    for row in table.rows:
        shown.add_row(*(Text(cell) for cell in row))
    return shown


def table_console() -> Console:
    """Return a console as wide as the terminal, and 100 columns wide where there is none."""
    from trailmark.report.terminal import TerminalConsole

    console = TerminalConsole()
    return console if console.is_terminal else TerminalConsole(width=_WIDTH)


def print_table(table: Table) -> None:
    """Print a table and what has to be known about it."""
    from rich.console import Console
    from rich.text import Text

    console, shown = table_console(), to_rich(table)
    if not console.is_terminal:  # a file has room: a name is not broken
        console.width = max(console.width, Console(width=_WIDEST).measure(shown).maximum)
    if table.title:
        console.print(Text(table.title, style="bold"))
    console.print(shown)
    for note in table.notes:
        console.print(Text(note, style="dim"))


def _header(column: Column) -> list[str]:
    """Return title and unit; short lines keep ten columns within 100 characters."""
    first, _, rest = column.title.partition(" ")
    return [first, *wrap(rest, _HEADER_WIDTH, break_long_words=False, break_on_hyphens=False), column.unit]
