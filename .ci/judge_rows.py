"""Read the rows of ``trailmark reproduce ... --json`` and fail where a bar of accuracy is missed. ::

    trailmark reproduce all --quick --json --out FOLDER > rows.json
    python .ci/judge_rows.py rows.json

Several files, one for each paper, are judged together; each must bring a bar of accuracy.

Times are printed and not judged: they say how busy the machine was.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

#: Units of what depends on the machine: times, and pictures a second.
_TIMES = ("ms", "s", "fps")

#: So few rows with a bar are no experiment: something has gone missing. The quick versions give 40 and more.
_FEWEST = 30


def is_time(row: Mapping[str, Any]) -> bool:
    """Return whether a row is a time, or a ratio of two."""
    return row["unit"] in _TIMES or (row["unit"] == "x" and row["item"].startswith("time"))


def is_accuracy(row: Mapping[str, Any]) -> bool:
    """Return whether a row has a bar that is judged."""
    return row["bar"] is not None and not is_time(row)


def line_of(row: Mapping[str, Any]) -> str:
    """Return a row as a line to read."""
    ours = "nothing" if row["ours"] is None else f"{row['ours']:.4g}"
    return f"{row['experiment']}, {row['item']}: {ours} {row['unit']}, asked for {row['bar']:.4g}"


def report(rows: Sequence[Mapping[str, Any]]) -> tuple[list[str], bool]:
    """Return lines to print, and whether every bar of accuracy is met."""
    accuracy = [row for row in rows if is_accuracy(row)]
    missed = [row for row in accuracy if not row["met"]]
    slow = [row for row in rows if row["bar"] is not None and is_time(row) and not row["met"]]
    lines = [f"missed: {line_of(row)}" for row in missed] + [f"slow (not judged): {line_of(row)}" for row in slow]
    lines.append(f"{len(accuracy) - len(missed)} of {len(accuracy)} bars of accuracy are met")
    if len(accuracy) < _FEWEST:
        lines.append(f"missed: only {len(accuracy)} rows have a bar of accuracy, {_FEWEST} are expected at least")
    return lines, not missed and len(accuracy) >= _FEWEST


def main() -> int:
    """Judge the files that the command line names."""
    files = {name: json.loads(Path(name).read_text(encoding="utf-8")) for name in sys.argv[1:]}
    lines, is_good = report([row for rows in files.values() for row in rows])
    without = [name for name, rows in files.items() if not any(is_accuracy(row) for row in rows)]
    print("\n".join([*lines, *(f"missed: {name} has no row with a bar of accuracy" for name in without)]))
    return 0 if is_good and not without else 1


if __name__ == "__main__":
    sys.exit(main())
