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
_FAITHFUL = "`faithful` is the method as the paper prints it, run here; `ours` is the default."


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
    judged = [row.met for row in rows if row.met is not None]
    return [
        f"# {title}",
        "",
        *([f"Paper: {reference}", ""] if reference else []),
        f"`{_command(provenance['command'])}`, {provenance['started'][:10]}, trailmark {provenance['trailmark']}, "
        f"{took_s / 60:.1f} min on {provenance['cpu']}.",
        *([f"All drives in one place, `world_seed` {provenance['place']}."] if "place" in provenance else []),
        f"{sum(judged)} of {len(judged)} bars are met.",
        *([_FAITHFUL] if any(row.faithful is not None for row in rows) else []),
        "",
        "| " + " | ".join(_HEADER) + " |",
        "|" + "|".join("--:" if column in _RIGHT else "---" for column in range(len(_HEADER))) + "|",
        *(_row(row) for row in rows),
        *_notes(rows),
        *_pictures(folder),
    ]


def _command(command: str) -> str:
    """Return the command as a reader types it, without the folder that the program lies in."""
    program, _, rest = command.partition(" ")
    return f"{Path(program).name} {rest}".strip()


def _row(row: Row) -> str:
    numbers = [_number(value) for value in (row.paper, row.faithful, row.ours, row.spread, row.bar, row.stretch)]
    verdict = {True: "met", False: "**not met**", None: ""}[row.met]
    return "| " + " | ".join([row.experiment, row.item, row.unit, *numbers, str(row.n), str(row.seeds), verdict]) + " |"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"


def _notes(rows: Sequence[Row]) -> list[str]:
    notes = [f"- {row.experiment}, {row.item}: {row.note}" for row in rows if row.note]
    return ["", *notes] if notes else []


def _pictures(folder: Path) -> list[str]:
    names = sorted(path.name for path in folder.glob("*.svg"))
    return [line for name in names for line in ("", f"![{Path(name).stem.replace('_', ' ')}]({name})")]
