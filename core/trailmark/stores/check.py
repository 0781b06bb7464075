"""Whether a path store is as it was written, row by row; a damaged one is noted, and the check goes on behind it."""

from __future__ import annotations

import sqlite3
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from trailmark.errors import ConfigError
from trailmark.frames.documents import sensor_from_document
from trailmark.stores import map_rows, tables
from trailmark.stores.faults import SQLITE_ERRORS, Damage, DamagedStoreError
from trailmark.stores.files import lacks_log, open_for_reading

__all__ = ["Findings", "check_store"]

T = TypeVar("T")
Row = tuple[Any, ...]

_MAX_PROBLEMS = 50
_MAX_BLIND_STEPS = 200_000  # rows tried one by one behind a damaged page: half a second


@dataclass(slots=True)
class Findings:
    """What a check found.

    Attributes
    ----------
    problems : list of str
        What is not as it was written; empty for a sound store.
    n_more : int
        Problems beyond those that are listed.
    readable : dict of str to (int, int or None)
        For each sort of row how many can be read, and how many there should be (None: not known any more).
    """

    problems: list[str] = field(default_factory=list)
    n_more: int = 0
    readable: dict[str, tuple[int, int | None]] = field(default_factory=dict)

    @property
    def is_sound(self) -> bool:
        """Whether everything is as it was written."""
        return not self.problems

    def add(self, problem: object) -> None:
        """Note a problem."""
        if len(self.problems) < _MAX_PROBLEMS:
            self.problems.append(" ".join(str(problem).split()))
        else:
            self.n_more += 1

    def count(self, what: str, n_good: int, n_expected: int | None) -> None:
        """Note how many of a sort of row can be read."""
        self.readable[what] = (n_good, n_expected)
        if n_expected is not None and n_good != n_expected:
            self.add(f"{what}: {n_good} can be read, and there should be {n_expected}")

    def attempt(self, read: Callable[..., T], *arguments: Any) -> T | None:
        """Return what a reader gives, or None with the problem noted."""
        try:
            return read(*arguments)
        except (Damage, ConfigError, *SQLITE_ERRORS) as error:
            self.add(error)
            return None


def check_store(path: Path) -> Findings:
    """Read and verify every row of a store.

    Raises
    ------
    StoreError
        If the file is missing, no path store, or of a newer schema.
    """
    findings = Findings()
    if path.is_file() and lacks_log(path):
        findings.add("its log is missing: copied while it was being taught, it lacks what stood there")
    try:
        connection, _, clean_up = open_for_reading(path, is_checked=False)
    except DamagedStoreError as error:
        findings.add(error)
        return findings
    try:
        with closing(connection):
            connection.execute("BEGIN")
            for finding in findings.attempt(_page_findings, connection) or ():
                findings.add(f"pages: {finding}")
            _check_facts(connection, findings)
            totals = findings.attempt(tables.read_totals, connection)
            n_facts = findings.attempt(tables.count_facts, connection)
            findings.count("entries", n_facts or 0, None if totals is None else totals.facts)
            _check_waypoints(connection, totals, findings)
            _check_maps(connection, totals, findings)
    finally:
        clean_up()
    return findings


def _page_findings(connection: sqlite3.Connection) -> list[str]:
    findings = connection.execute("PRAGMA quick_check(20)").fetchall()
    return [str(finding) for (finding,) in findings if finding != "ok"]


def _check_facts(connection: sqlite3.Connection, findings: Findings) -> None:
    findings.attempt(tables.read_document, connection, "meta")
    sensors = findings.attempt(tables.read_document, connection, "sensors") or {}
    for document in sensors.values():
        findings.attempt(sensor_from_document, document)


def _check_waypoints(connection: sqlite3.Connection, totals: tables.Totals | None, findings: Findings) -> None:
    rows = _rows(connection, "waypoints", "id, station_m, x, y, theta, crc", findings)
    good = [findings.attempt(tables.waypoint_numbers, row[1:]) for row in rows]
    n_good = sum(numbers is not None for numbers in good)
    findings.count("waypoints", n_good, None if totals is None else totals.waypoints)


def _check_maps(connection: sqlite3.Connection, totals: tables.Totals | None, findings: Findings) -> None:
    columns = "id, owner, finished, n_keyframes, n_saved, crc"
    rows = [findings.attempt(map_rows.map_of, row[1:]) for row in _rows(connection, "drawers", columns, findings)]
    maps = {row.id: row for row in rows if row is not None}
    findings.count("drawers", len(maps), None if totals is None else totals.drawers)
    for table, columns, reader in (
        ("keyframes", map_rows.KEYFRAME, map_rows.keyframe_of),
        ("saved", map_rows.SAVED, map_rows.saved_of),
    ):
        good: Counter[int] = Counter()
        for _, number, *rest in _rows(connection, table, columns, findings):
            owner = maps[number].owner if number in maps else f"drawer {number!r}"
            good[number] += findings.attempt(reader, (number, *rest), owner) is not None
        for row in maps.values():
            expected = row.n_keyframes if table == "keyframes" else row.n_saved
            findings.count(f"{table} of {row.owner}", good[row.id], expected)


def _rows(connection: sqlite3.Connection, table: str, columns: str, findings: Findings) -> Iterator[Row]:
    """Yield the rows of a table, each behind its id; behind a damaged page, they are tried one after the other."""
    last = -1
    try:
        for row in connection.execute(f"SELECT id, {columns} FROM {table} ORDER BY id"):
            last = row[0]
            yield row
        return
    except SQLITE_ERRORS as error:
        findings.add(f"{table} behind row {last}: {error}")
    for number in range(last + 1, _last_id(connection, table, last) + 1):
        try:
            yield from connection.execute(f"SELECT id, {columns} FROM {table} WHERE id = ?", (number,)).fetchall()
        except SQLITE_ERRORS:
            continue  # noted above; the totals say how many are missing


def _last_id(connection: sqlite3.Connection, table: str, last: int) -> int:
    try:
        found: int | None = connection.execute(f"SELECT max(id) FROM {table}").fetchone()[0]
    except SQLITE_ERRORS:
        found = None
    return last + _MAX_BLIND_STEPS if found is None else min(found, last + _MAX_BLIND_STEPS)
