"""Opening a bench to show what it found."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trailmark.errors import DataError
from trailmark_bench.index import INDEX_FILE, Index

__all__ = ["open_filled"]


@contextmanager
def open_filled(folder: Path) -> Iterator[Index]:
    """Open the index of a bench that holds cells.

    Raises
    ------
    DataError
        If the folder is not of a bench, or holds no cell: a config that is refused leaves such a folder.
    """
    with Index(folder) as index:
        if not _holds_cells(index):
            raise DataError(f"{folder} holds no cell: no bench has begun in it; 'trailmark bench CONFIG' runs one")
        yield index


def _holds_cells(index: Index) -> bool:
    try:
        return bool(index.states())
    except sqlite3.DatabaseError as error:  # a file of no table, as a kill at the first instant leaves it
        raise DataError(f"{index.folder / INDEX_FILE} is no index of a bench: {error}") from error
