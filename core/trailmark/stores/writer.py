"""The one writer of a path store, and what a killed one leaves beside it.

While it is written, a store has SQLite's write-ahead log beside it (``-wal``, ``-shm``) and the mark of its writer
(``-writer``). A writer that closes folds all of it into the one file; after a killed one, whoever opens the store next
and may write there does so.
"""

from __future__ import annotations

import contextlib
import logging
import sqlite3
from pathlib import Path
from typing import Literal

from trailmark.errors import StoreError
from trailmark.stores.faults import SQLITE_ERRORS, is_in_use, primary_code

__all__ = ["WriterMark", "connect", "fold", "fold_connection", "is_unfolded", "side_files"]

logger = logging.getLogger(__name__)

_SIDE_FILES = ("-wal", "-shm", "-journal")
_WRITER = "-writer"
_BUSY_S = 10.0
_ATTEMPTS = 5
_MAX_ROW_BYTES = 1_000_000_000

Access = Literal["ro", "rw", "rwc"]


def connect(path: Path, access: Access, *, is_immutable: bool = False) -> sqlite3.Connection:
    """Return a connection that trusts nothing in the file; transactions are begun and ended by hand.

    What is immutable is read as it stands: nothing is made or looked for beside it.
    """
    uri = f"{path.as_uri()}?mode={access}&immutable={int(is_immutable)}"
    connection = sqlite3.connect(uri, timeout=_BUSY_S, isolation_level=None, check_same_thread=False, uri=True)
    try:
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _MAX_ROW_BYTES)
        connection.setlimit(sqlite3.SQLITE_LIMIT_ATTACHED, 0)
        connection.execute("PRAGMA trusted_schema = OFF")
        connection.execute("PRAGMA cell_size_check = ON")
    except BaseException:
        connection.close()
        raise
    return connection


def side_files(path: Path) -> list[Path]:
    """Return the files of SQLite that stand beside a store."""
    beside = [path.with_name(path.name + suffix) for suffix in _SIDE_FILES]
    return [file for file in beside if file.exists()]


def is_unfolded(path: Path) -> bool:
    """Return whether a writer is at work, or left something behind."""
    return bool(side_files(path)) or path.with_name(path.name + _WRITER).exists()


class WriterMark:
    """Marks a path as being written, across processes, from start to close.

    The system releases the mark of a process that died. It is an empty SQLite file, locked as a whole: the same call
    on every system, and also between two stores of one process. (Locking the store itself would lock its readers
    out.)

    Parameters
    ----------
    path : Path
        The path store's file; the mark lies beside it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = path.with_name(path.name + _WRITER)
        self._connection: sqlite3.Connection | None = None

    def take(self, wait_s: float = 0.5) -> None:
        """Take the mark; a short wait lets programs finish that only fold the journal into the file.

        Raises
        ------
        StoreError
            If another writer has it, or the folder cannot be written.
        """
        for _ in range(_ATTEMPTS):
            connection = self._lock(wait_s)
            if self._file.exists():  # else its last owner removed it just before it let go
                self._connection = connection
                return
            connection.close()
        raise StoreError(f"{self._path} is opened and closed for writing by others all the time; try again")

    def give_back(self) -> None:
        """Release the mark and remove it; does nothing without one."""
        if self._connection is None:
            return
        connection, self._connection = self._connection, None
        with contextlib.suppress(OSError):
            if self._file.stat().st_size == 0:  # never remove what somebody else put there
                self._file.unlink()
        connection.close()

    def _lock(self, wait_s: float) -> sqlite3.Connection:
        connection = None
        try:
            connection = sqlite3.connect(self._file, timeout=wait_s, isolation_level=None, check_same_thread=False)
            connection.execute("PRAGMA journal_mode = MEMORY")  # a lock needs no journal beside it
            connection.execute("BEGIN EXCLUSIVE")
            return connection
        except SQLITE_ERRORS as error:
            if connection is not None:
                connection.close()
            raise self._refusal(error) from error

    def _refusal(self, error: Exception) -> StoreError:
        if is_in_use(error):
            return StoreError(f"{self._path} is being written by another process; end that one, or take another file")
        if primary_code(error) in (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY):
            return StoreError(f"{self._path} cannot be written: its folder is read-only; copy the store elsewhere")
        return StoreError(f"{self._path} cannot be marked as being written by {self._file.name}: {error}; remove that")


def fold(path: Path) -> None:
    """Fold what a killed writer left beside a path store into it, where that can be done; no error where not."""
    if not is_unfolded(path):
        return
    mark = WriterMark(path)
    try:
        mark.take(wait_s=0.0)
        with contextlib.closing(connect(path, "rw")) as connection:
            fold_connection(connection)
        logger.info("folded what an unfinished writer had left into %s", path)
    except (StoreError, *SQLITE_ERRORS) as error:
        logger.debug("left %s as it is: %s", path, error)
    finally:
        mark.give_back()


def fold_connection(connection: sqlite3.Connection) -> None:
    """Bring the log into the file and leave SQLite's log mode, so that the file stands alone."""
    connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    connection.execute("PRAGMA journal_mode = DELETE")
