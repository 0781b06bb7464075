"""Opening the file of a path store, by readers and by the writer.

Reading never changes what a store holds. An older schema, or what a killed writer left on a read-only folder,
is read from a private copy.
"""

from __future__ import annotations

import contextlib
import logging
import os
import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from trailmark.errors import StoreError
from trailmark.stores.faults import SQLITE_ERRORS, primary_code, store_errors
from trailmark.stores.migrations import migrate
from trailmark.stores.schema import APPLICATION_ID, HEAD_BYTES, VERSION, has_our_mark, identify
from trailmark.stores.writer import connect, fold, is_unfolded, side_files

__all__ = ["is_path_store", "lacks_log", "open_for_reading", "open_for_writing", "use_log"]

logger = logging.getLogger(__name__)

#: A file up to this size is checked as a whole when it is opened (0.3 s); a larger one row by row, as it is read.
_QUICK_CHECK_BYTES = 256 << 20


def is_path_store(path: Path) -> bool:
    """Return whether a file calls itself a path store, damaged or not, of whatever schema."""
    try:
        with contextlib.closing(connect(path, "ro")) as connection:
            return has_our_mark(connection)
    except SQLITE_ERRORS:  # too damaged for SQLite: the head of the file is looked at as it is
        with path.open("rb") as file:
            return file.read(HEAD_BYTES)[-4:] == APPLICATION_ID.to_bytes(4, "big")


def lacks_log(path: Path) -> bool:
    """Return whether the file says that its newest commits stand in a log beside it, and there is none.

    Bytes 18 and 19 of an SQLite file are 2 while it is written through a log. A writer that closes folds the log and
    sets them back; a killed one leaves log and mark. So the file was copied or moved away from its log. (Or another
    program of SQLite's was the last to leave it, which cannot be told apart.)
    """
    with path.open("rb") as file:
        head = file.read(20)
    return head[18:20] == b"\2\2" and not is_unfolded(path)


def _warn_of_missing_log(path: Path) -> None:
    if lacks_log(path):
        logger.warning(
            "%s was not closed by its writer, and the writer's log is not beside it: if this file was copied without"
            " its log, the newest waypoints are missing here; 'trailmark store copy' takes everything",
            path,
        )


def open_for_reading(path: Path, is_checked: bool = True) -> tuple[sqlite3.Connection, int, Callable[[], None]]:
    """Open a store without changing what it holds; an older schema is read from a migrated private copy.

    Parameters
    ----------
    path : Path
        The file.
    is_checked : bool
        Whether a file whose pages do not hang together is refused.

    Returns
    -------
    connection : sqlite3.Connection
        On the store or on its copy, in the schema of this program.
    schema : int
        The schema of the file.
    clean_up : callable
        Removes the copy; to be called when the connection is closed.
    """
    _refuse_without_file(path)
    with store_errors(path):
        _warn_of_missing_log(path)
        connection, schema, clean_up = _identify(path)
        if is_unfolded(path) and not clean_up.is_copy:
            connection.close()
            fold(path)
            connection, schema, clean_up = _identify(path)
        with _closing_on_error(connection, clean_up):
            if is_checked:
                _check_whole_file(connection, path)
            if schema < VERSION:
                connection, clean_up = _migrated_copy(connection, clean_up, schema)
    return connection, schema, clean_up


def open_for_writing(path: Path) -> sqlite3.Connection:
    """Open a store to go on writing it; an older schema is migrated where it is. Its writer mark must be held."""
    _refuse_without_file(path)
    with store_errors(path):
        _warn_of_missing_log(path)
        connection = connect(path, "ro")  # another's file is not touched: looked at first, for reading only
        with contextlib.closing(connection):
            identify(connection, path)
        connection = connect(path, "rw")
        with _closing_on_error(connection):
            _check_whole_file(connection, path)
            migrate(connection, identify(connection, path))
            use_log(connection)
    return connection


def use_log(connection: sqlite3.Connection) -> None:
    """Write through a log from here on: readers are never in the way, and a commit waits for no disk.

    A commit is in the hands of the operating system when it returns, so it outlives the process; losing power
    may cost the newest commits, never the file (docs/decisions/0004-path-store-format.md).
    """
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = NORMAL")


class _CleanUp:
    """Removes a private copy, if one was made."""

    def __init__(self, folder: tempfile.TemporaryDirectory[str] | None = None) -> None:
        self.is_copy = folder is not None
        self._folder = folder

    def __call__(self) -> None:
        if self._folder is not None:
            self._folder.cleanup()


def _identify(path: Path) -> tuple[sqlite3.Connection, int, _CleanUp]:
    connection, clean_up = _connect_to_read(path)
    with _closing_on_error(connection, clean_up):
        return connection, identify(connection, path), clean_up


def _connect_to_read(path: Path) -> tuple[sqlite3.Connection, _CleanUp]:
    """Open where it is; where SQLite would have to write beside the file and cannot, open a copy."""
    try:
        # A file without its log is read as it stands: SQLite would make an empty log, and nobody would know any more.
        connection = connect(path, "ro", is_immutable=lacks_log(path))
        with _closing_on_error(connection):
            connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
        return connection, _CleanUp()
    except sqlite3.OperationalError as error:
        if primary_code(error) not in (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY) or not os.access(
            path, os.R_OK
        ):
            raise
    folder = tempfile.TemporaryDirectory(prefix="trailmark-")
    clean_up = _CleanUp(folder)
    try:
        copy = Path(folder.name) / "copy.trail"
        shutil.copyfile(path, copy)
        for suffix in ("-wal", "-journal"):
            with contextlib.suppress(FileNotFoundError):
                shutil.copyfile(path.with_name(path.name + suffix), copy.with_name(copy.name + suffix))
        return connect(copy, "rw"), clean_up
    except BaseException:
        clean_up()
        raise


def _migrated_copy(connection: sqlite3.Connection, old: _CleanUp, schema: int) -> tuple[sqlite3.Connection, _CleanUp]:
    folder = tempfile.TemporaryDirectory(prefix="trailmark-")
    copy, clean_up = None, _CleanUp(folder)
    try:
        copy = connect(Path(folder.name) / "copy.trail", "rwc")
        connection.backup(copy)
        migrate(copy, schema)
    except BaseException:
        if copy is not None:
            copy.close()
        clean_up()
        raise
    connection.close()
    old()
    return copy, clean_up


def _check_whole_file(connection: sqlite3.Connection, path: Path) -> None:
    if not side_files(path):  # SQLite takes what is missing of the last page for zeros
        (n_pages,), (page_bytes,) = (
            connection.execute(f"PRAGMA {what}").fetchone() for what in ("page_count", "page_size")
        )
        if (n_bytes := path.stat().st_size) < n_pages * page_bytes:
            raise sqlite3.DatabaseError(f"the file is cut: {n_bytes} of {n_pages * page_bytes} bytes are there")
    if path.stat().st_size <= _QUICK_CHECK_BYTES:
        (finding,) = connection.execute("PRAGMA quick_check(1)").fetchone()
        if finding != "ok":
            raise sqlite3.DatabaseError(" ".join(str(finding).split()))  # no code: told as damage


def _refuse_without_file(path: Path) -> None:
    if path.is_file():
        return
    if path.exists():
        raise StoreError(f"{path} is not a file, so not a path store")
    raise StoreError(f"no path store at {path}; 'trailmark teach CONFIG --store {path}' makes one")


@contextlib.contextmanager
def _closing_on_error(connection: sqlite3.Connection, clean_up: Callable[[], None] | None = None) -> Iterator[None]:
    try:
        yield
    except BaseException:
        connection.close()
        if clean_up is not None:
            clean_up()
        raise
