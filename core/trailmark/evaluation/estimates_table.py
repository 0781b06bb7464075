"""Reading ``estimates.csv`` of a run: every estimate and what became of it."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Bools, Floats, Indices
from trailmark.errors import DataError

__all__ = ["OUTCOMES", "EstimateTable", "read_estimates", "table_of_rows"]

#: What can become of an estimate, in the order of reports; `Lost` is one whatever its status says.
OUTCOMES = ("accepted", "gated", "late", "refused", "lost", "unused")

_INFORMATION = ("info_xx", "info_xy", "info_xt", "info_yy", "info_yt", "info_tt")
_NUMBERS = ("arrived_s", "since_s", "stamp_s", "x", "y", "theta", *_INFORMATION, "nis", "dof")
_WORDS = ("source", "kind", "status", "reason")


@dataclass(frozen=True, slots=True, eq=False)
class EstimateTable:
    """The columns of ``estimates.csv``, N rows each; NaN where a number is not given.

    Attributes
    ----------
    arrived_s, since_s, stamp_s : (N,) float64
        When the estimate was applied, and what time it is about [s].
    source, kind, outcome, reason : (N,) str
        The localizer; ``motion``, ``fix``, ``pathoffset`` or ``lost``; one of `OUTCOMES`; why.
    numbers : (N, 3) float64
        x, y, theta, or station, lateral, heading [m, m, rad].
    information : (N, 3, 3) float64
        Of the three numbers.
    nis, dof : (N,) float64
        Normalised innovation squared and its degrees of freedom.
    """

    arrived_s: Floats
    since_s: Floats
    stamp_s: Floats
    source: npt.NDArray[np.str_]
    kind: npt.NDArray[np.str_]
    outcome: npt.NDArray[np.str_]
    reason: npt.NDArray[np.str_]
    numbers: Floats
    information: Floats
    nis: Floats
    dof: Floats

    def __len__(self) -> int:
        return len(self.stamp_s)

    def sources(self) -> list[str]:
        """Return the names of the localizers in the order in which they first spoke."""
        names, first = np.unique(self.source, return_index=True)
        return [str(name) for name in names[np.argsort(first)]]

    def where(self, rows: Bools | Indices) -> EstimateTable:
        """Return some of the rows, in the order asked for."""
        return EstimateTable(*(getattr(self, name)[rows] for name in self.__slots__))

    def of(self, source: str) -> EstimateTable:
        """Return the rows of one localizer."""
        return self.where(self.source == source)

    def counts(self) -> dict[str, int]:
        """Return how many rows had each outcome, in the order of `OUTCOMES`, without zeros."""
        counted = {outcome: int((self.outcome == outcome).sum()) for outcome in OUTCOMES}
        return {outcome: n for outcome, n in counted.items() if n}


def read_estimates(path: str | Path) -> EstimateTable:
    """Read ``estimates.csv``. A last line that was cut off, as a killed run leaves it, is left out.

    Parameters
    ----------
    path : str or Path
        The file, as the recorder of a run writes it.

    Returns
    -------
    EstimateTable
        A row for each estimate, in the order of arrival.

    Raises
    ------
    DataError
        If the file cannot be read, a column is missing or a number is malformed; the message names the line.
    """
    if Path(path).exists() and not (Path(path).is_file() or Path(path).is_dir()):  # a pipe would be waited for
        raise DataError(f"cannot read {path}: it is a device or a pipe; write its text into a file")
    try:
        with open(path, encoding="utf-8", newline="") as file:
            return table_of_rows(_rows(file, path))
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise DataError(f"{path} is not a table of estimates: it is no text (byte {error.start})") from error
    except csv.Error as error:
        raise DataError(f"{path} is not a table of estimates: {error}") from error


def table_of_rows(rows: Iterable[tuple[str, Mapping[str, str]]]) -> EstimateTable:
    """Return rows, each with where it stands, as a table.

    Raises
    ------
    DataError
        If a number is malformed.
    """
    words: dict[str, list[str]] = {name: [] for name in _WORDS}
    numbers: list[list[float]] = []
    for where, row in rows:
        try:
            numbers.append([float(row[name] or "nan") for name in _NUMBERS])
        except ValueError as error:
            raise _malformed(row, where) from error
        for name in _WORDS:
            words[name].append(row[name])
    return _table(np.array(numbers, dtype=np.float64).reshape(-1, len(_NUMBERS)), words)


def _rows(file: Iterator[str], path: str | Path) -> Iterator[tuple[str, dict[str, str]]]:
    reader = csv.reader(file)
    header = next(reader, [])
    missing = [name for name in (*_NUMBERS, *_WORDS) if name not in header]
    if missing:
        raise DataError(f"{path}:1: no column '{missing[0]}'; the columns are {', '.join(header) or 'none'}")
    short: str | None = None
    for fields in reader:
        if short is not None:
            raise DataError(short)
        where = f"{path}:{reader.line_num}"
        if len(fields) == len(header):
            yield where, dict(zip(header, fields, strict=True))
        elif fields:  # told only when another line follows
            short = f"{where}: expected {len(header)} fields, found {len(fields)}"


def _malformed(row: Mapping[str, str], where: str) -> DataError:
    """Return what to say of a row one of whose numbers is none: the first."""
    for name in _NUMBERS:
        try:
            float(row[name] or "nan")
        except ValueError:
            break
    return DataError(f"{where}: {name} is not a number: {row[name][:40]!r}")


def _table(numbers: Floats, words: dict[str, list[str]]) -> EstimateTable:
    column = dict(zip(_NUMBERS, numbers.T, strict=True))
    xx, xy, xt, yy, yt, tt = (column[name] for name in _INFORMATION)
    information = np.stack([xx, xy, xt, xy, yy, yt, xt, yt, tt], axis=1).reshape(-1, 3, 3)
    kind = np.array([text.lower().replace("_", "") for text in words["kind"]], dtype=np.str_)
    outcome = np.where(kind == "lost", "lost", np.array(words["status"], dtype=np.str_))
    return EstimateTable(
        arrived_s=column["arrived_s"],
        since_s=column["since_s"],
        stamp_s=column["stamp_s"],
        source=np.array(words["source"], dtype=np.str_),
        kind=kind,
        outcome=outcome,
        reason=np.array(words["reason"], dtype=np.str_),
        numbers=np.stack([column["x"], column["y"], column["theta"]], axis=1),
        information=information,
        nis=column["nis"],
        dof=column["dof"],
    )
