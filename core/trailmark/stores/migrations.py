"""From every older schema to the next one; a file takes as many steps as it needs, all in one transaction."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Iterator
from typing import Any

import numpy.typing as npt

from trailmark.frames.array_documents import array_from_bytes
from trailmark.geometry import Pose2
from trailmark.paths import Keyframe, Waypoint
from trailmark.stores import map_rows, tables
from trailmark.stores.faults import Damage
from trailmark.stores.rows import check_name, pack_arrays
from trailmark.stores.schema import TABLES, VERSION, create_schema

__all__ = ["migrate"]


def migrate(connection: sqlite3.Connection, version: int) -> None:
    """Bring a store to the schema of this program; nothing of it happens when any of it fails.

    Raises
    ------
    Damage
        If the old file holds something that its schema does not allow.
    """
    if version == VERSION:
        return
    connection.execute("BEGIN IMMEDIATE")
    try:
        for step in range(version, VERSION):
            _MIGRATIONS[step](connection)
        connection.execute("COMMIT")
    except BaseException as error:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        if isinstance(error, ValueError | TypeError | OverflowError | RecursionError):
            raise Damage(f"its schema {version} does not hold what it should: {error}") from error
        raise


def _from_1_to_2(connection: sqlite3.Connection) -> None:
    """Schema 1 had a row per array and no checksums."""
    names = [statement.split()[2] for statement in TABLES[1]]
    for name in names:
        connection.execute(f"ALTER TABLE {name} RENAME TO old_{name}")
    create_schema(connection, 2)
    tables.write_totals(connection, tables.Totals())
    for key, value in connection.execute("SELECT key, value FROM old_facts").fetchall():
        check_name(key, "an entry")
        tables.write_fact(connection, key, json.loads(value))
    for index, station_m, x, y, theta in connection.execute("SELECT * FROM old_waypoints ORDER BY idx").fetchall():
        tables.add_waypoint(connection, Waypoint(index, station_m, Pose2(x, y, theta)))
    for drawer, owner, finished in connection.execute("SELECT id, owner, finished FROM old_drawers").fetchall():
        _drawer_from_1_to_2(connection, drawer, owner, bool(finished))
    for name in names:
        connection.execute(f"DROP TABLE old_{name}")


def _drawer_from_1_to_2(connection: sqlite3.Connection, drawer: int, owner: str, finished: bool) -> None:
    check_name(owner, "a drawer")
    row = map_rows.add_map(connection, owner)
    old = connection.execute("SELECT * FROM old_keyframes WHERE drawer = ? ORDER BY id", (drawer,)).fetchall()
    for number, _, station_m, stamp_s, x, y, theta in old:
        arrays = dict(_arrays_of_1(connection, "keyframe = ?", drawer, number))
        keyframe = Keyframe(station_m, stamp_s, Pose2(x, y, theta), arrays)
        row = map_rows.add_keyframe(connection, row, keyframe, *pack_arrays(arrays))
    names = connection.execute("SELECT DISTINCT saved_as FROM old_arrays WHERE drawer = ?", (drawer,)).fetchall()
    for name in [name for (name,) in names if name is not None]:
        check_name(name, "saved arrays")
        arrays = dict(_arrays_of_1(connection, "saved_as = ?", drawer, name))
        row = map_rows.save_arrays(connection, row, name, *pack_arrays(arrays))
    map_rows.set_finished(connection, row, finished)


def _arrays_of_1(
    connection: sqlite3.Connection, which: str, drawer: int, key: int | str
) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    found = connection.execute(
        f"SELECT name, dtype, shape, data FROM old_arrays WHERE drawer = ? AND {which} ORDER BY id", (drawer, key)
    )
    for name, dtype_name, shape, data in found.fetchall():
        lengths = [int(length) for length in shape.split(",")] if shape else []
        yield name, array_from_bytes(data, dtype_name, lengths)


_MIGRATIONS: dict[int, Callable[[sqlite3.Connection], None]] = {1: _from_1_to_2}
