"""The results of an experiment as files: rows as JSON, and a page of Markdown to keep."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from trailmark.experiments import Row

__all__ = ["write_experiment"]

_HEADER = ("experiment", "item", "unit", "paper", "faithful", "ours", "±", "bar", "stretch", "n", "seeds", "")
_RIGHT = range(2, 11)
_FEW = ("in short", "unit", "paper", "faithful", "ours", "±", "bar", "")
_COLUMNS = (
    "`±` is one standard deviation over seeds or places; `n` counts samples, or places where a figure is of several: "
    "then one that says largest, max or worst is the worst of them, any other their mean."
)
_FAITHFUL = (
    "`faithful` is the method as the paper prints it, run here; `ours` is the default. It is empty where the paper has "
    "no such method (variants of ours, peers, timings of our parts), and where the printed method was not driven."
)


def write_experiment(
    folder: Path, title: str, reference: str, rows: Sequence[Row], provenance: dict[str, Any], took_s: float
) -> Path:
    """Write ``rows.json`` and ``results.md`` into a folder, with every ``*.svg`` that lies there; return the page.

    Parameters
    ----------
    folder : Path
        Is made where it is missing.
    title, reference : str
        Heading of the page, and the publication that the rows are compared with.
    rows : sequence of Row
        What the experiment reported.
    provenance : dict
        Of `trailmark.pipeline.outputs.provenance`: command, version, machine.
    took_s : float
        Wall time of the experiment [s].
    """
    folder.mkdir(parents=True, exist_ok=True)
    document = {"title": title, "took_s": round(took_s, 1), "provenance": provenance}
    document["rows"] = [row.document() for row in rows]
    (folder / "rows.json").write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    page = folder / "results.md"
    page.write_text("\n".join(_lines(folder, title, reference, rows, provenance, took_s)) + "\n", encoding="utf-8")
    return page


def _lines(
    folder: Path, title: str, reference: str, rows: Sequence[Row], provenance: dict[str, Any], took_s: float
) -> list[str]:
    head = [
        f"# {title}",
        "",
        *([f"Paper: {reference}", ""] if reference else []),
        f"`{_command(provenance['command'])}`, {provenance['started'][:10]}, trailmark {provenance['trailmark']}, "
        f"{took_s / 60:.1f} min on {provenance['cpu']}.",
        *([f"All drives in one place, `world_seed` {provenance['place']}."] if "place" in provenance else []),
        *_verdict(rows),
        *([_COLUMNS] if any(row.spread is not None for row in rows) else []),
        *([_FAITHFUL] if any(row.faithful is not None for row in rows) else []),
    ]
    table = [_line(_HEADER), _rule(_HEADER, _RIGHT), *(_row(row) for row in rows)]
    few = [row for row in rows if row.is_headline]
    if few:
        head += ["", _line(_FEW), _rule(_FEW, range(2, 7)), *(_few_row(row) for row in few)]
        table = _folded(f"All {len(rows)} figures", table)
    notes = [f"- {row.experiment}, {row.item}: {row.note}" for row in rows if row.note]
    folded = _folded("How each was measured, and in each place", notes) if notes else []
    return [*head, "", *table, *([""] if notes else []), *folded, *_pictures(folder)]


def _verdict(rows: Sequence[Row]) -> list[str]:
    """Return how many bars are met, and by name those that are not."""
    judged = [row for row in rows if row.met is not None]
    missed = [
        f"- {row.experiment}, {row.item}: {_number(row.ours) or 'not measured'} {row.unit}".rstrip()
        + f", asked for {_number(row.bar)}"
        for row in judged
        if not row.met
    ]
    count = f"{len(judged) - len(missed)} of {len(judged)} bars are met"
    return [f"{count}. Missed:", "", *missed, ""] if missed else [f"{count}."]


def _folded(summary: str, lines: Sequence[str]) -> list[str]:
    """Return lines of Markdown that a reader unfolds; GitHub and MkDocs (`md_in_html`) both show them."""
    return ['<details markdown="1">', f"<summary>{summary}</summary>", "", *lines, "", "</details>"]


def _command(command: str) -> str:
    """Return the command as a reader types it, without the folder that the program lies in."""
    program, _, rest = command.partition(" ")
    return f"{Path(program).name} {rest}".strip()


def _row(row: Row) -> str:
    numbers = [_number(value) for value in (row.paper, row.faithful, row.ours, row.spread, row.bar, row.stretch)]
    return _line([row.experiment, row.item, row.unit, *numbers, str(row.n), str(row.seeds), _mark(row)])


def _few_row(row: Row) -> str:
    numbers = [_number(value) for value in (row.paper, row.faithful, row.ours, row.spread, row.bar)]
    return _line([f"{row.experiment}: {row.item}", row.unit, *numbers, _mark(row)])


def _mark(row: Row) -> str:
    return {True: "met", False: "**not met**", None: ""}[row.met]


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _rule(header: Sequence[str], right: range) -> str:
    return "|" + "|".join("--:" if column in right else "---" for column in range(len(header))) + "|"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"


def _pictures(folder: Path) -> list[str]:
    names = sorted(path.name for path in folder.glob("*.svg"))
    return [line for name in names for line in ("", f"![{Path(name).stem.replace('_', ' ')}]({name})")]
