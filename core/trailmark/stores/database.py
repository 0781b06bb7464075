"""The connection of a path store, for any thread; transactions, and the file that takes the place of an old one."""

from __future__ import annotations

import contextlib
import os
import sqlite3
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

from trailmark.errors import StoreError
from trailmark.stores import tables
from trailmark.stores.faults import SQLITE_ERRORS, store_error, store_errors
from trailmark.stores.files import is_path_store, open_for_reading, open_for_writing, use_log
from trailmark.stores.schema import PAGE_BYTES, VERSION, create_schema
from trailmark.stores.writer import WriterMark, connect, fold, fold_connection, is_unfolded, side_files

__all__ = ["Database", "check_replaceable", "sync_folder"]


class Database:
    """A path store's file, open; made by `to_read`, `to_append` or `to_create`.

    Attributes
    ----------
    path : Path
        The file.
    schema : int
        Schema of the file as it was found.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection, schema: int = VERSION) -> None:
        self.path = path
        self.schema = schema
        self._connection: sqlite3.Connection | None = connection
        self._lock = threading.RLock()
        self._mark: WriterMark | None = None  # held by the writer
        self._draft: Path | None = None  # written instead of `path` until it is put in its place
        self._replaces = False
        self._clean_up: Callable[[], None] | None = None
        self._broken: StoreError | None = None

    @classmethod
    def to_read(cls, path: Path) -> Database:
        """Open for reading only."""
        connection, schema, clean_up = open_for_reading(path)
        database = cls(path, connection, schema)
        database._clean_up = clean_up
        return database

    @classmethod
    def to_append(cls, path: Path) -> Database:
        """Open for going on."""
        with _hold_mark(path) as mark:
            database = cls(path, open_for_writing(path))
            database._mark = mark
        return database

    @classmethod
    def to_create(cls, path: Path, replaces: bool) -> Database:
        """Begin a new store beside the path; with `replaces`, an old store may stand there until the new one is put.

        Raises
        ------
        StoreError
            If something stands there that may not be replaced.
        """
        draft = path.with_name(path.name + ".new")
        with _hold_mark(path) as mark, store_errors(path), contextlib.ExitStack() as undo:
            if path.exists():
                check_replaceable(path, replaces, "go on with it by --append, or replace it by --overwrite-store")
            _remove(draft, *side_files(draft))  # of a writer that was killed: this one holds the mark
            connection = connect(draft, "rwc")
            database = cls(path, connection)
            database._draft, database._mark, database._replaces = draft, mark, replaces
            undo.callback(database.close)
            connection.execute(f"PRAGMA page_size = {PAGE_BYTES}")
            connection.execute("BEGIN IMMEDIATE")
            create_schema(connection)
            tables.write_totals(connection, tables.Totals())
            connection.execute("COMMIT")
            undo.pop_all()
        return database

    @contextlib.contextmanager
    def reading(self) -> Iterator[sqlite3.Connection]:
        """Give the connection in one unchanging state of the store; the open transaction's, if there is one."""
        with self._lock, store_errors(self.path):
            connection = self._open_connection()
            if connection.in_transaction:
                yield connection
                return
            connection.execute("BEGIN")
            try:
                yield connection
            finally:
                if connection.in_transaction:
                    connection.execute("ROLLBACK")

    @contextlib.contextmanager
    def writing(self) -> Iterator[sqlite3.Connection]:
        """Give the connection inside the open transaction; what is written in one block is kept whole or not at all."""
        with self._lock:
            connection = self._writable_connection()
            try:
                if not connection.in_transaction:
                    connection.execute("BEGIN IMMEDIATE")
                connection.execute("SAVEPOINT step")
                with store_errors(self.path):
                    yield connection
                connection.execute("RELEASE step")
            except SQLITE_ERRORS as error:
                raise self._broke(store_error(error, self.path)) from error
            except BaseException as error:
                self._undo_step(connection, error)
                raise

    @property
    def is_writable(self) -> bool:
        """Whether this is the writer."""
        return self._mark is not None

    def exclusively(self) -> contextlib.AbstractContextManager[object]:
        """Keep other threads out for the length of a block."""
        return self._lock

    def commit(self, replaces_old: bool) -> None:
        """End the open transaction. A draft takes its place; that of an old store, when `replaces_old` says so."""
        with self._lock:
            connection = self._writable_connection()
            try:
                with store_errors(self.path):
                    if connection.in_transaction:
                        connection.execute("COMMIT")
                    if self._draft is not None and (replaces_old or not self.path.exists()):
                        self._put_in_place(connection, self._draft)
            except StoreError as error:
                raise self._broke(error) from error

    def close(self) -> None:
        """Forget what was not committed, leave one file, and let go; twice is once."""
        with self._lock:
            connection, self._connection = self._connection, None
            if connection is None:
                return
            with contextlib.suppress(*SQLITE_ERRORS):
                if connection.in_transaction:
                    connection.execute("ROLLBACK")
                if self._mark is not None and self._draft is None:
                    fold_connection(connection)  # not with readers in the file: the next one folds it
            connection.close()
            if self._draft is not None:
                _remove(self._draft, *side_files(self._draft))
            if self._mark is not None:
                self._mark.give_back()
            if self._clean_up is not None:
                self._clean_up()
                fold(self.path)

    def _put_in_place(self, connection: sqlite3.Connection, draft: Path) -> None:
        """Move the draft over the path, in one step, and go on there.

        An SQLite file may not be moved while it is open (its journal would keep the old name), and what lies
        beside the old store would be read as the new one's log.
        """
        if self.path.exists() and not self._replaces:
            raise StoreError(f"{self.path} was made by somebody else meanwhile; take another name")
        connection.close()
        _remove(*side_files(self.path))
        os.replace(draft, self.path)
        sync_folder(self.path.parent)
        self._draft = None
        self._connection = connect(self.path, "rw")
        use_log(self._connection)

    def _open_connection(self) -> sqlite3.Connection:
        if self._connection is None:
            raise StoreError(f"{self.path} is closed")
        return self._connection

    def _writable_connection(self) -> sqlite3.Connection:
        connection = self._open_connection()
        if self._mark is None:
            raise StoreError(f"{self.path} is open for reading only; teaching writes it")
        if self._broken is not None:
            raise StoreError(str(self._broken)) from self._broken
        return connection

    def _undo_step(self, connection: sqlite3.Connection, error: BaseException) -> None:
        """Take back a step that failed in the middle; when SQLite failed in it, the transaction is gone."""
        if isinstance(error.__cause__, SQLITE_ERRORS) and isinstance(error, StoreError):
            self._broke(error)
            return
        with contextlib.suppress(*SQLITE_ERRORS):  # interrupted before the step began
            connection.execute("ROLLBACK TO step")
            connection.execute("RELEASE step")

    def _broke(self, error: StoreError) -> StoreError:
        """Give up writing: what was committed stays, and every later call says why."""
        self._broken = error
        if self._connection is not None:
            with contextlib.suppress(*SQLITE_ERRORS):
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
        return error


@contextlib.contextmanager
def _hold_mark(path: Path) -> Iterator[WriterMark]:
    """Hold the writer's mark; it is given back if the block fails."""
    if not path.parent.is_dir():
        raise StoreError(f"no folder {path.parent} for the path store {path.name}; make it first")
    mark = WriterMark(path)
    mark.take()
    try:
        yield mark
    except BaseException:
        mark.give_back()
        raise


def check_replaceable(path: Path, replaces: bool, remedy: str) -> None:
    """Check that an old store may be replaced, and bring all of it into its one file, so that it is whole until then.

    Raises
    ------
    StoreError
        If it may not, or if somebody reads an older state of it, so that its log cannot be emptied.
    """
    if not replaces:
        raise StoreError(f"{path} exists already; {remedy}")
    if not path.is_file():
        raise StoreError(f"{path} is not a file, so it is not overwritten; take another name")
    if path.stat().st_size == 0:
        return
    if not is_path_store(path):
        raise StoreError(
            f"{path} is not a path store, so it is not overwritten; remove it yourself, or take another name"
        )
    if is_unfolded(path) and not _is_emptied(path):
        raise StoreError(
            f"{path} is being read, and what its last writer left beside it cannot be brought into it; end the reader"
        )


def _is_emptied(path: Path) -> bool:
    """Bring the log of a store whose writer mark we hold into its file; True too where the file is past reading."""
    try:
        with contextlib.closing(connect(path, "rw")) as connection:
            busy, n_pages, n_copied = connection.execute("PRAGMA wal_checkpoint(FULL)").fetchone()
    except SQLITE_ERRORS:
        return True
    return bool(busy == 0 and n_pages == n_copied)


def _remove(*files: Path) -> None:
    for file in files:
        file.unlink(missing_ok=True)


def sync_folder(folder: Path) -> None:
    """Make a rename outlive a loss of power, where the system lets a folder be synced."""
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
