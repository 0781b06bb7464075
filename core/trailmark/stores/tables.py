"""The rows of facts and waypoints; what is read is verified against its checksum and the totals."""

from __future__ import annotations

import json
import math
import sqlite3
import struct
from array import array
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any
from zlib import crc32

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import ShapeError, StoreError
from trailmark.geometry import Pose2
from trailmark.paths import Waypoint
from trailmark.stores.faults import Damage
from trailmark.stores.rows import checksum

__all__ = [
    "Totals",
    "add_waypoint",
    "count_facts",
    "finite",
    "move_waypoints",
    "pose_numbers",
    "read_document",
    "read_fact",
    "read_totals",
    "read_waypoints",
    "waypoint_numbers",
    "write_fact",
    "write_totals",
]

Connection = sqlite3.Connection
Row = tuple[Any, ...]


TOTALS = "totals"

# Four floats as `checksum` takes them: each with its type and length before it.
_FOUR_FLOATS = struct.Struct("<3sd3sd3sd3sd")
# Checksum of what comes before the index, by the number of its digits.
_BEGINNINGS = [crc32(b"waypointsi%d:" % n_digits) for n_digits in range(21)]


@dataclass(frozen=True, slots=True)
class Totals:
    """How many rows the tables must have: a page of the file that is lost takes its rows along without an error.

    Attributes
    ----------
    waypoints, drawers, facts : int
        Rows of the tables of these names.
    """

    waypoints: int = 0
    drawers: int = 0
    facts: int = 1


def write_fact(connection: Connection, key: str, value: Any) -> None:
    """Keep a JSON-able value under a key, replacing what stood there."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    row = (checksum("facts", key, text), text, key)
    if connection.execute("UPDATE facts SET crc = ?, value = ? WHERE key = ?", row).rowcount == 0:
        connection.execute("INSERT INTO facts (crc, value, key) VALUES (?, ?, ?)", row)
        if key != TOTALS:
            totals = read_totals(connection)
            write_totals(connection, replace(totals, facts=totals.facts + 1))


def read_fact(connection: Connection, key: str) -> Any:
    """Return the value kept under a key, or None."""
    rows = connection.execute("SELECT key, crc, value FROM facts WHERE key = ?", (key,)).fetchmany(2)
    if len(rows) > 1:
        raise Damage(f"the entry {key!r} is there twice")
    if rows:
        return _value_of(rows[0])
    for row in connection.execute("SELECT key, crc, value FROM facts"):  # else a damaged key would pass for none
        _value_of(row)
    return None


def _value_of(row: Row) -> Any:
    key, crc, text = row
    if crc != checksum("facts", key, text):
        raise Damage(f"the entry {_short(key)} is not as it was written")
    try:
        return json.loads(text)
    except (TypeError, ValueError, RecursionError) as error:
        raise Damage(f"the entry {_short(key)} cannot be read: {error}") from error


def read_document(connection: Connection, key: str) -> dict[str, Any]:
    """Return the mapping kept under a key; empty where there is none."""
    document = read_fact(connection, key)
    if document is None and count_facts(connection) != read_totals(connection).facts:
        raise Damage(f"the entry {key!r} may be lost: an entry is missing")
    if document is not None and not isinstance(document, dict):
        raise Damage(f"the entry {key!r} is no mapping")
    return document or {}


def count_facts(connection: Connection) -> int:
    """Return how many entries there are."""
    (count,) = connection.execute("SELECT count(*) FROM facts").fetchone()
    return int(count)


def write_totals(connection: Connection, totals: Totals) -> None:
    """Write down how many rows there are."""
    write_fact(connection, TOTALS, asdict(totals))


def read_totals(connection: Connection) -> Totals:
    """Return how many rows there must be."""
    document = read_fact(connection, TOTALS)
    numbers = list(document.values()) if isinstance(document, dict) else []
    if (
        not numbers
        or list(document) != [field.name for field in fields(Totals)]
        or any(type(n) is not int or n < 0 for n in numbers)
    ):
        raise Damage("it does not say how many rows it has")
    return Totals(*numbers)


def add_waypoint(connection: Connection, waypoint: Waypoint) -> None:
    """Add the next waypoint.

    Raises
    ------
    StoreError
        If its index or station does not follow the last one.
    """
    totals = read_totals(connection)
    index, station_m = int(waypoint.index), finite(waypoint.station_m, "a waypoint's station")
    if index != totals.waypoints:
        raise StoreError(f"waypoint {index} does not follow: the store has {totals.waypoints}, so the next is that")
    last = connection.execute("SELECT station_m FROM waypoints WHERE id = ?", (index - 1,)).fetchone()
    if last is not None and not last[0] < station_m:
        raise StoreError(f"waypoint {index} at {station_m} m does not lie after the one before it, at {last[0]} m")
    numbers = (station_m, *pose_numbers(waypoint.pose_map_base))
    connection.execute(
        "INSERT INTO waypoints VALUES (?, ?, ?, ?, ?, ?)", (index, *numbers, checksum("waypoints", index, *numbers))
    )
    write_totals(connection, replace(totals, waypoints=index + 1))


def move_waypoints(connection: Connection, poses: Sequence[Pose2]) -> None:
    """Give every waypoint another pose.

    Raises
    ------
    StoreError
        If there are not as many.
    """
    stations: list[float] = read_waypoints(connection)[:, 0].tolist()
    if len(stations) != len(poses):
        raise StoreError(f"{len(poses)} poses for {len(stations)} waypoints")
    for index, (station_m, pose) in enumerate(zip(stations, poses, strict=True)):
        numbers = (station_m, *pose_numbers(pose))
        row = (*numbers[1:], checksum("waypoints", index, *numbers), index)
        connection.execute("UPDATE waypoints SET x = ?, y = ?, theta = ?, crc = ? WHERE id = ?", row)


def read_waypoints(connection: Connection, count: int | None = None) -> Floats:
    """Return station, x, y and heading of the first `count` waypoints; without it, of all there must be.

    Returns
    -------
    (N, 4) float64
        [m, m, m, rad].
    """
    count = read_totals(connection).waypoints if count is None else count
    numbers = array("d")
    found = 0
    for row in connection.execute("SELECT * FROM waypoints WHERE id < ? ORDER BY id", (count,)):
        if row[0] != found:
            break
        numbers.extend(waypoint_numbers(row))
        found += 1
    if found != count:
        raise Damage(f"waypoint {found} of {count} is missing")
    return np.array(numbers).reshape(-1, 4)


def waypoint_numbers(row: Row) -> tuple[float, float, float, float]:
    """Return station, x, y and heading of a waypoint's row, verified."""
    index, station_m, x, y, theta, crc = row
    try:
        is_intact = crc == _waypoint_checksum(index, station_m, x, y, theta)
    except (TypeError, struct.error):  # another type stands in a column of numbers
        is_intact = False
    if not is_intact:
        raise Damage(f"waypoint {_short(index)} is not as it was written")
    if not (math.isfinite(station_m) and math.isfinite(x) and math.isfinite(y) and math.isfinite(theta)):
        raise Damage(f"waypoint {_short(index)} cannot be read: a number of it is not finite")
    return station_m, x, y, theta


def _waypoint_checksum(index: int, station_m: float, x: float, y: float, theta: float) -> int:
    """Return the checksum of a waypoint's row in one go: a path has a hundred thousand of them."""
    digits = b"%d" % index
    floats = _FOUR_FLOATS.pack(b"f8:", station_m, b"f8:", x, b"f8:", y, b"f8:", theta)
    return crc32(digits + floats, _BEGINNINGS[len(digits)])


def finite(value: float, what: str) -> float:
    """Return a number as SQLite keeps it: finite, and without negative zero."""
    if not math.isfinite(value):
        raise ShapeError(f"{what} is not finite: {value}")
    return float(value) + 0.0


def pose_numbers(pose: Pose2) -> tuple[float, float, float]:
    """Return the numbers of a pose as SQLite keeps them."""
    return float(pose.x) + 0.0, float(pose.y) + 0.0, float(pose.theta) + 0.0


def _short(value: Any) -> str:
    return repr(value)[:60]
