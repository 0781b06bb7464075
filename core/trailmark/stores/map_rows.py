"""The rows of localizer maps: keyframes, and arrays that were saved under a name; all verified when they are read.

The file keeps a map as a row of the table ``drawers``, its old name.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy.typing as npt

from trailmark.errors import StoreError
from trailmark.geometry import Pose2
from trailmark.paths import Keyframe
from trailmark.stores.faults import Damage
from trailmark.stores.rows import checksum, unpack_arrays
from trailmark.stores.tables import finite, pose_numbers, read_totals, write_totals

__all__ = [
    "KEYFRAME",
    "SAVED",
    "MapRow",
    "add_keyframe",
    "add_map",
    "find_map",
    "keyframe_of",
    "map_of",
    "move_keyframes",
    "read_keyframes",
    "read_maps",
    "read_saved",
    "save_arrays",
    "saved_names",
    "saved_of",
    "set_finished",
]

ArrayMap = dict[str, npt.NDArray[Any]]
Connection = sqlite3.Connection
Row = tuple[Any, ...]

#: The columns that `keyframe_of` reads.
KEYFRAME = "drawer, number, station_m, stamp_s, x, y, theta, crc, layout, data"

#: The columns that `saved_of` reads.
SAVED = "drawer, name, crc, layout, data"


@dataclass(frozen=True, slots=True)
class MapRow:
    """A localizer map, as a row of the table ``drawers``.

    Attributes
    ----------
    id : int
        Number of the map; the other tables refer to it.
    owner : str
        Name of the localizer.
    is_finished : bool
        Whether the localizer's `finish` ran.
    n_keyframes, n_saved : int
        How many keyframes and saved names belong to it.
    """

    id: int
    owner: str
    is_finished: bool = False
    n_keyframes: int = 0
    n_saved: int = 0

    def checksum(self) -> int:
        """Return the checksum of its row."""
        return checksum("drawers", self.id, self.owner, int(self.is_finished), self.n_keyframes, self.n_saved)


def add_map(connection: Connection, owner: str) -> MapRow:
    """Add the map of an owner, and return its row."""
    totals = read_totals(connection)
    row = MapRow(totals.drawers, owner)
    connection.execute("INSERT INTO drawers VALUES (?, ?, ?, ?, ?, ?)", (row.id, owner, 0, 0, 0, row.checksum()))
    write_totals(connection, replace(totals, drawers=totals.drawers + 1))
    return row


def read_maps(connection: Connection) -> list[MapRow]:
    """Return the rows of all maps in the order in which they were made."""
    count = read_totals(connection).drawers
    rows = connection.execute("SELECT * FROM drawers ORDER BY id").fetchmany(count + 1)
    maps = [map_of(row) for row in rows]
    if [row.id for row in maps] != list(range(count)) or len({row.owner for row in maps}) != count:
        raise Damage(f"{count} drawers should be there, but their list is not complete")
    return maps


def map_of(row: Row) -> MapRow:
    """Return the map that a row of the table describes, verified."""
    number, owner, finished, n_keyframes, n_saved, crc = row
    is_typed = isinstance(owner, str) and all(type(n) is int and n >= 0 for n in (finished, n_keyframes, n_saved))
    found = MapRow(number, owner, finished == 1, n_keyframes, n_saved)
    if not is_typed or crc != found.checksum():
        raise Damage(f"drawer {_short(owner)} is not as it was written")
    return found


def find_map(connection: Connection, owner: str) -> MapRow | None:
    """Return the map of an owner, or None."""
    return next((row for row in read_maps(connection) if row.owner == owner), None)


def set_finished(connection: Connection, row: MapRow, is_finished: bool) -> MapRow:
    """Write down whether the owner's `finish` ran."""
    return _update(connection, replace(row, is_finished=is_finished))


def _update(connection: Connection, row: MapRow) -> MapRow:
    connection.execute(
        "UPDATE drawers SET finished = ?, n_keyframes = ?, n_saved = ?, crc = ? WHERE id = ?",
        (int(row.is_finished), row.n_keyframes, row.n_saved, row.checksum(), row.id),
    )
    return row


def add_keyframe(connection: Connection, row: MapRow, keyframe: Keyframe, layout: str, data: bytes) -> MapRow:
    """Add a keyframe with its packed arrays; the map is unfinished from here on."""
    station_m = finite(keyframe.station_m, "a keyframe's station")
    stamp_s = finite(keyframe.stamp_s, "a keyframe's stamp")
    values = (row.id, row.n_keyframes, station_m, stamp_s, *pose_numbers(keyframe.pose_map_base))
    connection.execute(
        "INSERT INTO keyframes VALUES (NULL, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        (*values, checksum("keyframes", *values, layout, data), layout, data),
    )
    return _update(connection, replace(row, n_keyframes=row.n_keyframes + 1, is_finished=False))


def move_keyframes(
    connection: Connection, row: MapRow, keyframes: Sequence[Keyframe], packed: Sequence[tuple[str, bytes]]
) -> MapRow:
    """Put keyframes, with their packed arrays, in place of those there are; the map is unfinished from here on.

    Raises
    ------
    StoreError
        If there are not as many.
    """
    if row.n_keyframes != len(keyframes):
        raise StoreError(f"{len(keyframes)} keyframes in place of {row.n_keyframes} of {row.owner!r}")
    connection.execute("DELETE FROM keyframes WHERE drawer = ?", (row.id,))
    row = replace(row, n_keyframes=0)
    for keyframe, (layout, data) in zip(keyframes, packed, strict=True):
        row = add_keyframe(connection, row, keyframe, layout, data)
    return row


def read_keyframes(connection: Connection, row: MapRow) -> Iterator[Keyframe]:
    """Yield the keyframes of a map in the order in which they were added."""
    found = 0
    for values in connection.execute(f"SELECT {KEYFRAME} FROM keyframes WHERE drawer = ? ORDER BY id", (row.id,)):
        keyframe = keyframe_of(values, row.owner)
        if values[1] != found:
            break
        found += 1
        yield keyframe
    if found != row.n_keyframes:
        raise Damage(f"keyframe {found} of {row.owner!r} is missing; there should be {row.n_keyframes}")


def keyframe_of(values: Row, owner: str) -> Keyframe:
    """Return the keyframe of a row."""
    *head, crc, layout, data = values
    what = f"keyframe {_short(head[1])} of {owner!r}"
    if crc != checksum("keyframes", *head, layout, data):
        raise Damage(f"{what} is not as it was written")
    try:
        station_m, stamp_s, x, y, theta = (finite(value, "a number of it") for value in head[2:])
        return Keyframe(station_m, stamp_s, Pose2(x, y, theta), unpack_arrays(layout, data))
    except (TypeError, ValueError) as error:
        raise Damage(f"{what} cannot be read: {error}") from error


def save_arrays(connection: Connection, row: MapRow, name: str, layout: str, data: bytes) -> MapRow:
    """Save packed arrays under a name, replacing what stood there; the map is unfinished from here on."""
    gone = connection.execute("DELETE FROM saved WHERE drawer = ? AND name = ?", (row.id, name)).rowcount
    connection.execute(
        "INSERT INTO saved VALUES (NULL, ?, ?, ?, ?, ?)",
        (row.id, name, checksum("saved", row.id, name, layout, data), layout, data),
    )
    return _update(connection, replace(row, n_saved=row.n_saved - gone + 1, is_finished=False))


def saved_names(connection: Connection, row: MapRow) -> list[str]:
    """Return the names under which a map has saved arrays."""
    found = connection.execute("SELECT name FROM saved WHERE drawer = ? ORDER BY id", (row.id,)).fetchall()
    names = [name for (name,) in found]
    if len(set(names)) != row.n_saved or len(names) != row.n_saved:
        raise Damage(f"{row.owner!r} has saved {row.n_saved} sets of arrays, but {len(names)} are there")
    return names


def read_saved(connection: Connection, row: MapRow, name: str) -> ArrayMap | None:
    """Return the arrays that were saved under a name, or None."""
    if name in saved_names(connection, row):
        values = connection.execute(f"SELECT {SAVED} FROM saved WHERE drawer = ? AND name = ?", (row.id, name))
        return saved_of(values.fetchone(), row.owner)
    for other in connection.execute(f"SELECT {SAVED} FROM saved WHERE drawer = ?", (row.id,)):
        saved_of(other, row.owner)  # else a damaged name would pass for none
    return None


def saved_of(values: Row, owner: str) -> ArrayMap:
    """Return the saved arrays of a row."""
    drawer, name, crc, layout, data = values
    what = f"{_short(name)} of {owner!r}"
    if crc != checksum("saved", drawer, name, layout, data):
        raise Damage(f"{what} is not as it was written")
    try:
        return unpack_arrays(layout, data)
    except (TypeError, ValueError) as error:
        raise Damage(f"{what} cannot be read: {error}") from error


def _short(value: Any) -> str:
    return repr(value)[:60]
