"""Rows of numbers of a table that a run has left, whatever has become of it since."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

from trailmark.errors import DataError

__all__ = ["read_number_rows"]


def read_number_rows(file: Path, columns: Sequence[str], what: str) -> list[list[float]]:
    """Read columns of a table with a head.

    Parameters
    ----------
    file : Path
        The table.
    columns : sequence of str
        Names of the columns, in the order in which their numbers are returned.
    what : str
        What it is, for errors: ``a table of beliefs``.

    Raises
    ------
    DataError
        If it cannot be read, or a number is none; the message names the line.
    """
    try:
        with open(file, encoding="utf-8", newline="") as source:
            reader = csv.DictReader(source)
            missing = [name for name in columns if name not in (reader.fieldnames or ())]
            if missing:
                raise DataError(f"{file} is not {what}: it has no column {missing[0]!r}")
            return [[_number(row[name], name, f"{file}:{reader.line_num}") for name in columns] for row in reader]
    except OSError as error:
        raise DataError(f"cannot read {file}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise DataError(f"{file} is not {what}: it is no text (byte {error.start})") from error
    except csv.Error as error:
        raise DataError(f"{file} is not {what}: {error}") from error


def _number(text: str | None, name: str, where: str) -> float:
    try:
        return float(text or "")
    except (TypeError, ValueError):
        raise DataError(f"{where}: {name} is {(text or '')[:40]!r}, not a number") from None
