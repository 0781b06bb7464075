"""The tables of a path store, and how a file is known to be one."""

from __future__ import annotations

import sqlite3
from pathlib import Path

from trailmark.errors import StoreError
from trailmark.stores.faults import Damage

__all__ = [
    "APPLICATION_ID",
    "HEAD_BYTES",
    "PAGE_BYTES",
    "TABLES",
    "VERSION",
    "create_schema",
    "has_our_mark",
    "identify",
]

#: SQLite's ``application_id`` of a path store: "TRLM".
APPLICATION_ID = 0x54524C4D

#: The head of an SQLite file as far as the ``application_id``, which is big-endian.
HEAD_BYTES = 72

#: The schema that this program writes; ``user_version`` of the file.
VERSION = 2

#: A keyframe of 2 kB takes 2.2 kB in pages of this size, and 4.2 kB in SQLite's usual ones of 4096 bytes.
PAGE_BYTES = 1024

_VERSION_1 = (
    "CREATE TABLE facts (key TEXT PRIMARY KEY, value TEXT NOT NULL)",
    "CREATE TABLE waypoints (idx INTEGER PRIMARY KEY, station_m REAL, x REAL, y REAL, theta REAL)",
    "CREATE TABLE drawers (id INTEGER PRIMARY KEY, owner TEXT NOT NULL UNIQUE, finished INTEGER NOT NULL)",
    "CREATE TABLE keyframes (id INTEGER PRIMARY KEY, drawer INTEGER NOT NULL, station_m REAL, stamp_s REAL,"
    " x REAL, y REAL, theta REAL)",
    "CREATE TABLE arrays (id INTEGER PRIMARY KEY, drawer INTEGER NOT NULL, keyframe INTEGER, saved_as TEXT,"
    " name TEXT NOT NULL, dtype TEXT NOT NULL, shape TEXT NOT NULL, data BLOB NOT NULL)",
)

# Every row has a checksum, and none is found through an index: an index that lost an entry hides a row silently.
_VERSION_2 = (
    "CREATE TABLE facts (id INTEGER PRIMARY KEY, key TEXT NOT NULL, crc INTEGER NOT NULL, value TEXT NOT NULL)",
    "CREATE TABLE waypoints (id INTEGER PRIMARY KEY, station_m REAL NOT NULL, x REAL NOT NULL, y REAL NOT NULL,"
    " theta REAL NOT NULL, crc INTEGER NOT NULL)",
    "CREATE TABLE drawers (id INTEGER PRIMARY KEY, owner TEXT NOT NULL, finished INTEGER NOT NULL,"
    " n_keyframes INTEGER NOT NULL, n_saved INTEGER NOT NULL, crc INTEGER NOT NULL)",
    "CREATE TABLE keyframes (id INTEGER PRIMARY KEY, drawer INTEGER NOT NULL, number INTEGER NOT NULL,"
    " station_m REAL NOT NULL, stamp_s REAL NOT NULL, x REAL NOT NULL, y REAL NOT NULL, theta REAL NOT NULL,"
    " crc INTEGER NOT NULL, layout TEXT NOT NULL, data BLOB NOT NULL)",
    "CREATE TABLE saved (id INTEGER PRIMARY KEY, drawer INTEGER NOT NULL, name TEXT NOT NULL, crc INTEGER NOT NULL,"
    " layout TEXT NOT NULL, data BLOB NOT NULL)",
)

#: The tables of every schema that this program reads.
TABLES: dict[int, tuple[str, ...]] = {1: _VERSION_1, 2: _VERSION_2}


def create_schema(connection: sqlite3.Connection, version: int = VERSION) -> None:
    """Make the tables of a schema and mark the file as a path store; belongs in a transaction."""
    for statement in TABLES[version]:
        connection.execute(statement)
    connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    connection.execute(f"PRAGMA user_version = {version}")


def identify(connection: sqlite3.Connection, path: Path) -> int:
    """Return the schema of a path store, after a look at what else the file would bring.

    Tables that differ from ours in a single letter, a view or a trigger are refused before any of them is read:
    a stranger's file may not run statements of its own.

    Raises
    ------
    StoreError
        If the file is something else, or of a newer schema.
    Damage
        If it is a path store with other tables than its schema has.
    """
    if not has_our_mark(connection):
        other = "an empty file" if path.stat().st_size == 0 else "another SQLite file"
        raise StoreError(f"{path} is not a path store but {other}; check the file's name")
    version = _pragma(connection, "user_version")
    if version > VERSION:
        raise StoreError(
            f"{path} was written by a newer Trailmark: it has schema {version}, and this one knows up to {VERSION}."
            " Update Trailmark to read it"
        )
    if version not in TABLES:
        raise Damage(f"there is no schema {version}")
    found = connection.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL").fetchmany(100)
    if sorted(str(sql) for (sql,) in found) != sorted(TABLES[version]):
        raise Damage(f"its tables are not those of schema {version}")
    return version


def has_our_mark(connection: sqlite3.Connection) -> bool:
    """Return whether the file says that it is a path store."""
    return _pragma(connection, "application_id") == APPLICATION_ID


def _pragma(connection: sqlite3.Connection, name: str) -> int:
    return int(connection.execute(f"PRAGMA {name}").fetchone()[0])
