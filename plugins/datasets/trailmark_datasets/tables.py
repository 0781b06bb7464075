"""Tables of numbers with named columns: CSV of any delimiter, or blanks, with or without a header row."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

from trailmark.errors import SourceError
from trailmark_datasets.textfiles import is_number, lines_of, number

__all__ = ["DataTable", "TableRow", "column_names", "open_table"]

#: Other names under which a column is found without being told.
ALIASES: Mapping[str, tuple[str, ...]] = {
    "t": ("time", "timestamp", "stamp", "time_s", "stamp_s", "t_s"),
    "theta": ("yaw", "heading"),
    "omega": ("w", "yaw_rate"),
    "file": ("filename", "image", "name"),
}


@dataclass(frozen=True, slots=True)
class TableRow:
    """One line of a table.

    Attributes
    ----------
    where : str
        File and line, for messages.
    fields : mapping of str to str
        The text of every column that has a meaning.
    """

    where: str
    fields: Mapping[str, str]

    def number(self, column: str) -> float:
        """Return the number in a column, or raise `SourceError` naming file, line and column."""
        return number(self.fields[column], f"column {column!r}", self.where)


@dataclass(frozen=True, slots=True)
class DataTable:
    """A table whose columns are known and whose rows are read when asked for.

    Attributes
    ----------
    path : Path
        The file.
    columns : mapping of str to int
        Where each known column stands.
    n_fields : int
        Fields of a line.
    delimiter : str or None
        None: blanks.
    header_line : int
        Line of the header; 0: none.
    """

    path: Path
    columns: Mapping[str, int]
    n_fields: int
    delimiter: str | None
    header_line: int

    def rows(self) -> Iterator[TableRow | SourceError]:
        """Yield the rows; a line with another number of fields as its error."""
        for line, text in lines_of(self.path):
            if line <= self.header_line:
                continue
            fields = _split(text, self.delimiter)
            where = f"{self.path}:{line}"
            if len(fields) < self.n_fields:
                yield SourceError(f"{where}: expected {self.n_fields} fields, found {len(fields)}: {text[:60]!r}")
            else:
                yield TableRow(where, {name: fields[index] for name, index in self.columns.items()})


def open_table(
    path: Path, known: Sequence[str], header: Sequence[str] | None = None, columns: Mapping[str, str] | None = None
) -> DataTable:
    """Read the header of a table.

    Parameters
    ----------
    path : Path
        The file; ``.gz`` and ``.bz2`` are unpacked. Lines that start with ``#``, ``%`` or ``//`` are comments.
    known : sequence of str
        Columns that have a meaning; others are ignored.
    header : sequence of str, optional
        Names of the columns of a file that has no header row.
    columns : mapping of str to str, optional
        Columns that bear another name in the file: meaning to name.

    Raises
    ------
    SourceError
        If there is no header, or a column named in `columns` is not there.
    """
    line, delimiter, names = _read_header(path, header)
    found = _find_columns(names, known, columns or {}, f"{path}:{line}" if header is None else "header")
    return DataTable(path, found, max(found.values(), default=-1) + 1, delimiter, 0 if header is not None else line)


def column_names(path: Path, header: Sequence[str] | None = None) -> list[str]:
    """Return the names of a table's columns, in lower case and without units; see `open_table`."""
    return _read_header(path, header)[2]


def _read_header(path: Path, header: Sequence[str] | None) -> tuple[int, str | None, list[str]]:
    """Return the first line's number, the delimiter and the names of the columns."""
    first = next(lines_of(path), None)
    if first is None:
        raise SourceError(f"{path} holds no rows")
    line, text = first
    delimiter = next((mark for mark in ";,\t" if mark in text and (mark != "\t" or header is None)), None)
    fields = _split(text, delimiter)
    if header is None and all(is_number(field) for field in fields):
        raise SourceError(
            f"{path}:{line} has no header row; name its {len(fields)} columns in the config: header: [t, ...]"
        )
    return line, delimiter, [_normal(name) for name in (fields if header is None else header)]


def _find_columns(names: Sequence[str], known: Sequence[str], columns: Mapping[str, str], where: str) -> dict[str, int]:
    found: dict[str, int] = {}
    for meaning in known:
        wanted = (_normal(columns[meaning]),) if meaning in columns else (meaning, *ALIASES.get(meaning, ()))
        index = next((names.index(name) for name in wanted if name in names), None)
        if index is not None:
            found[meaning] = index
        elif meaning in columns:
            close = get_close_matches(wanted[0], names, n=1)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            raise SourceError(f"{where}: no column {columns[meaning]!r}{hint}; columns: {', '.join(names)}")
    return found


def _split(text: str, delimiter: str | None) -> list[str]:
    return [field.strip().strip("\"'") for field in text.split(delimiter)]


def _normal(name: str) -> str:
    """Return a column's name without quotes, its unit in brackets, and case."""
    bare = name.strip().strip("\"'").split("[")[0].split("(")[0]
    return bare.strip().lower()
