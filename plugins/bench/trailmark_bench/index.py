"""The index of a bench: what became of every cell, in one SQLite file beside the cells' folders.

The folder of a cell is the record; the index is for finding one's way. One process writes it (a lock sees to that),
one transaction a cell, so that a kill at any instant loses at most what was running.
"""

from __future__ import annotations

import json
import sqlite3
import time
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from trailmark.deprecation import deprecated_name
from trailmark.errors import ConfigError, DataError
from trailmark.isolation.fingerprint import FileCache
from trailmark.isolation.outcome import Outcome
from trailmark_bench.cell import Cell
from trailmark_bench.lock import LOCK_FILE, FolderLock

__all__ = ["INDEX_FILE", "CellRecord", "Index"]

INDEX_FILE = "index.sqlite"

_SCHEMA = 1
_TABLES = """
CREATE TABLE cells (
  id TEXT PRIMARY KEY, ordinal INTEGER NOT NULL, matrix TEXT NOT NULL, coordinates TEXT NOT NULL,
  wanted INTEGER NOT NULL DEFAULT 1, state TEXT NOT NULL, reason TEXT NOT NULL DEFAULT '',
  stderr TEXT NOT NULL DEFAULT '', attempts INTEGER NOT NULL DEFAULT 0, finished_s REAL,
  wall_s REAL, cpu_s REAL, peak_rss_mb REAL, load REAL, host TEXT, result TEXT, detail BLOB
);
CREATE TABLE files (path TEXT, size INTEGER, mtime_ns INTEGER, digest TEXT, PRIMARY KEY (path, size, mtime_ns));
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL);
"""
_COLUMNS = "id, matrix, coordinates, state, reason, attempts, wall_s, cpu_s, peak_rss_mb, load, host, result"


@dataclass(frozen=True, slots=True, eq=False)
class CellRecord:
    """A cell and what became of it.

    Attributes
    ----------
    id, matrix, coordinates
        As of the `Cell`.
    state, reason : str
        What became of it, and why.
    attempts : int
        How often it was run.
    wall_s, cpu_s, peak_rss_mb, load, host
        Of its process; None while it has not run.
    result : mapping
        ``result.json``: ``metrics``, ``times``, ``counters``, ``errors``; empty without one.
    """

    id: str
    matrix: str
    coordinates: Mapping[str, Any]
    state: str
    reason: str = ""
    attempts: int = 0
    wall_s: float | None = None
    cpu_s: float | None = None
    peak_rss_mb: float | None = None
    load: float | None = None
    host: str | None = None
    result: Mapping[str, Any] = field(default_factory=dict, repr=False)

    @property
    def label(self) -> str:
        """The coordinates in words."""
        return Cell(self.id, self.matrix, self.coordinates, {}).label


class Index:
    """The index of a bench's folder.

    Parameters
    ----------
    folder : Path
        Of the bench.
    write : bool
        Whether to run cells: the folder is made, and nobody else may do so meanwhile.

    Raises
    ------
    ConfigError
        If another bench works in the folder, or it cannot be written to.
    DataError
        If there is no bench in it, or a newer Trailmark wrote it.
    """

    def __init__(self, folder: str | Path, write: bool = False) -> None:
        self.folder = Path(folder)
        path = self.folder / INDEX_FILE
        self._lock: FolderLock | None = None
        self._depth = 0
        if write:
            self._take(self.folder)
        elif not path.is_file():
            raise DataError(f"{folder} is not the folder of a bench: it has no {INDEX_FILE}")
        try:
            self._db = sqlite3.connect(path if write else f"{path.absolute().as_uri()}?mode=ro", uri=not write)
            self._prepare(write)
        except sqlite3.DatabaseError as error:
            self.close()
            raise DataError(f"{path}: {error}; the cells' own folders are untouched") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file and let others work in the folder."""
        if hasattr(self, "_db"):
            if self._lock is not None:
                with suppress(sqlite3.Error):  # one file again, for whoever copies it or may only read
                    self._db.execute("PRAGMA journal_mode = DELETE")
            self._db.close()
        if self._lock is not None:
            self._lock.release()

    # --- cells ---------------------------------------------------------------------------------------------------

    def enter(self, cells: Sequence[Cell]) -> None:
        """Write down the cells of a bench; those that are known keep what became of them.

        Cells of the folder that are not among these stay, and are not shown: they are of another config or code.
        """
        with self._transaction() as db:
            db.execute("UPDATE cells SET wanted = 0")
            db.executemany(
                "INSERT INTO cells (id, ordinal, matrix, coordinates, state, reason) VALUES (?, ?, ?, ?, ?, ?)"
                " ON CONFLICT (id) DO UPDATE SET wanted = 1, ordinal = excluded.ordinal, matrix = excluded.matrix,"
                " coordinates = excluded.coordinates",
                [
                    (
                        cell.id,
                        ordinal,
                        cell.matrix,
                        json.dumps(cell.coordinates),
                        "skipped" if cell.missing else "pending",
                        cell.missing,
                    )
                    for ordinal, cell in enumerate(cells)
                ],
            )

    def mark_running(self, cell_id: str) -> None:
        """Write down that a cell is running."""
        with self._transaction() as db:
            db.execute(
                "UPDATE cells SET state = 'running', reason = '', attempts = attempts + 1 WHERE id = ?", (cell_id,)
            )

    def mark_pending(self, cell_ids: Iterable[str]) -> None:
        """Write down that cells are to be run, whatever became of them."""
        with self._transaction() as db:
            db.executemany(
                "UPDATE cells SET state = 'pending', reason = '', result = NULL, detail = NULL WHERE id = ?",
                [(cell_id,) for cell_id in cell_ids],
            )

    def mark_finished(self, cell_id: str, outcome: Outcome, result: Any = None, detail: bytes | None = None) -> None:
        """Write down what became of a cell; `detail` is the content of its ``detail.json``, for its page."""
        packed = None if detail is None else zlib.compress(detail, 6)
        with self._transaction() as db:
            db.execute(
                "UPDATE cells SET state = ?, reason = ?, stderr = ?, finished_s = ?, wall_s = ?, cpu_s = ?,"
                " peak_rss_mb = ?, load = ?, host = ?, result = ?, detail = ? WHERE id = ?",
                (
                    outcome.state,
                    outcome.reason,
                    outcome.stderr,
                    time.time(),
                    outcome.wall_s,
                    outcome.cpu_s,
                    outcome.peak_rss_mb,
                    outcome.load,
                    outcome.host,
                    None if result is None else json.dumps(result, separators=(",", ":")),
                    packed,
                    cell_id,
                ),
            )

    def copy_from(self, other: Index, cell_ids: Iterable[str]) -> None:
        """Take over cells of another bench, with what became of them."""
        names = [row[1] for row in self._db.execute("PRAGMA table_info(cells)")]  # ours: theirs may be anything
        marks = ", ".join("?" * len(names))
        with self._transaction() as db:
            for cell_id in cell_ids:
                row = other._db.execute(f"SELECT {', '.join(names)} FROM cells WHERE id = ?", (cell_id,)).fetchone()
                db.execute(f"INSERT OR REPLACE INTO cells ({', '.join(names)}) VALUES ({marks})", row)

    def records(self, everything: bool = False) -> list[CellRecord]:
        """Return the cells in their order; with `everything` also those of earlier configs and code."""
        chosen = "" if everything else " WHERE wanted = 1"
        rows = self._db.execute(f"SELECT {_COLUMNS} FROM cells{chosen} ORDER BY wanted DESC, ordinal, id")
        return [_record(row) for row in rows]

    def states(self) -> dict[str, str]:
        """Return the state of every cell by its id."""
        return dict(self._db.execute("SELECT id, state FROM cells"))

    def stderr(self, cell_id: str) -> str:
        """Return the end of what a cell wrote to standard error."""
        row = self._db.execute("SELECT stderr FROM cells WHERE id = ?", (cell_id,)).fetchone()
        return "" if row is None else str(row[0])

    def details(self) -> Iterator[tuple[str, bytes | None, str]]:
        """Yield id, ``detail.json`` as zlib packs it, and standard error of the cells in their order."""
        rows = self._db.execute("SELECT id, detail, stderr FROM cells WHERE wanted = 1 ORDER BY ordinal, id")
        yield from rows

    # --- what else there is --------------------------------------------------------------------------------------

    def set_meta(self, **values: Any) -> None:
        """Keep facts about the bench."""
        with self._transaction() as db:
            db.executemany(
                "INSERT OR REPLACE INTO meta VALUES (?, ?)", [(key, json.dumps(value)) for key, value in values.items()]
            )

    def meta(self) -> dict[str, Any]:
        """Return the facts about the bench."""
        return {key: json.loads(value) for key, value in self._db.execute("SELECT key, value FROM meta")}

    def file_digests(self) -> FileCache:
        """Return the digests of files that were looked at before."""
        return {row[:3]: row[3] for row in self._db.execute("SELECT path, size, mtime_ns, digest FROM files")}

    def keep_file_digests(self, cache: FileCache) -> None:
        """Keep the digests of files."""
        with self._transaction() as db:
            db.executemany(
                "INSERT OR REPLACE INTO files VALUES (?, ?, ?, ?)", [(*key, digest) for key, digest in cache.items()]
            )

    def _take(self, folder: Path) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for name in (INDEX_FILE, LOCK_FILE, "cells", "frames"):  # a stranger's folder may lead out of itself
                if (folder / name).is_symlink():
                    raise ConfigError(f"{folder / name} is a link; a bench is not written through one")
            self._lock = FolderLock(folder)
        except BlockingIOError:
            raise ConfigError(f"another bench is at work in {folder}; wait for it, or choose another --out") from None
        except OSError as error:
            raise ConfigError(f"cannot write to {folder}: {error.strerror or error}") from error

    def _prepare(self, write: bool) -> None:
        version = int(self._db.execute("PRAGMA user_version").fetchone()[0])
        if version > _SCHEMA:
            raise DataError(f"{self.folder}: its index was written by a newer Trailmark (schema {version}); upgrade")
        if write:
            self._db.execute("PRAGMA journal_mode = WAL")  # whoever looks on does not disturb
            self._db.execute("PRAGMA synchronous = NORMAL")
            if version == 0:
                with self._db:
                    self._db.executescript(f"BEGIN; {_TABLES} PRAGMA user_version = {_SCHEMA}; COMMIT;")

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Write many things in one transaction, all or none."""
        with self._transaction():
            self._depth += 1
            try:
                yield
            finally:
                self._depth -= 1

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        if self._depth:
            yield self._db
            return
        try:
            with self._db:
                yield self._db
        except sqlite3.OperationalError as error:  # the disk is full
            raise DataError(
                f"cannot write {self.folder / INDEX_FILE}: {error}; finished cells are kept: run the bench again"
            ) from error


def _record(row: Sequence[Any]) -> CellRecord:
    """Return a row of the columns `_COLUMNS`."""
    cell_id, matrix, coordinates, state, reason, attempts, wall_s, cpu_s, peak_rss_mb, load, host, result = row
    try:
        where, figures = json.loads(coordinates), {} if result is None else json.loads(result)
    except (ValueError, TypeError, RecursionError) as error:
        raise DataError(f"the index of the bench is damaged: cell {str(cell_id)[:60]!r}: {error}") from error
    if not isinstance(where, dict) or not isinstance(figures, dict):
        raise DataError(f"the index of the bench is damaged: cell {str(cell_id)[:60]!r} has no coordinates or figures")
    return CellRecord(
        id=cell_id,
        matrix=matrix,
        coordinates=where,
        state=state,
        reason=reason,
        attempts=attempts,
        wall_s=wall_s,
        cpu_s=cpu_s,
        peak_rss_mb=peak_rss_mb,
        load=load,
        host=host,
        result=figures,
    )


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {"Record": CellRecord})
