"""Stores of schema 1, built from SQL as its program wrote them, are read and gone on with."""

from __future__ import annotations

import json
import os
import sqlite3
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from trailmark.errors import StoreError
from trailmark.frames import SensorInfo
from trailmark.geometry import Pose2
from trailmark.stores.check import check_store
from trailmark.stores.survey import describe_store

SCHEMA_1 = """
CREATE TABLE facts (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE waypoints (idx INTEGER PRIMARY KEY, station_m REAL, x REAL, y REAL, theta REAL);
CREATE TABLE drawers (id INTEGER PRIMARY KEY, owner TEXT NOT NULL UNIQUE, finished INTEGER NOT NULL);
CREATE TABLE keyframes (id INTEGER PRIMARY KEY, drawer INTEGER NOT NULL, station_m REAL, stamp_s REAL,\
 x REAL, y REAL, theta REAL);
CREATE TABLE arrays (id INTEGER PRIMARY KEY, drawer INTEGER NOT NULL, keyframe INTEGER, saved_as TEXT,\
 name TEXT NOT NULL, dtype TEXT NOT NULL, shape TEXT NOT NULL, data BLOB NOT NULL);
PRAGMA application_id = 0x54524C4D;
PRAGMA user_version = 1;
"""


@pytest.fixture
def old(tmp_path: Path) -> Path:
    """A store of schema 1: three waypoints, two keyframes, one saved array."""
    path = tmp_path / "old.trail"
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript(SCHEMA_1)
        facts = {"sensors": {"floor": {"name": "floor", "kind": "image"}}, "meta": {"trailmark": "0.0.1"}}
        connection.executemany("INSERT INTO facts VALUES (?, ?)", [(k, json.dumps(v)) for k, v in facts.items()])
        connection.executemany(
            "INSERT INTO waypoints VALUES (?, ?, ?, 0.0, 0.0)",
            [(index, 0.1 * index, 0.1 * index) for index in range(3)],
        )
        connection.execute("INSERT INTO drawers VALUES (5, 'floor', 0), (9, 'laser', 1)")
        for number in (17, 18):
            connection.execute(
                "INSERT INTO keyframes VALUES (?, 5, ?, ?, 1, 2, 0.5)", (number, number / 10, number * 1.0)
            )
            patch = np.full((2, 3), number, np.uint8)
            connection.execute(
                "INSERT INTO arrays VALUES (NULL, 5, ?, NULL, 'patch', 'uint8', '2,3', ?)", (number, patch.tobytes())
            )
        points = np.array([1.5, -2.0])
        connection.execute(
            "INSERT INTO arrays VALUES (NULL, 9, NULL, 'map', 'points', 'float64', '2', ?), "
            "(NULL, 9, NULL, 'map', 'count', 'int32', '', ?)",
            (points.tobytes(), np.int32(2).tobytes()),
        )
        connection.commit()
    return path


def check_contents(store: object) -> None:
    assert [waypoint.station_m for waypoint in store.path().waypoints] == [0.0, 0.1, 0.2]
    first, second = store.localizer_map("floor").keyframes()
    assert (first.station_m, first.stamp_s, first.pose_map_base) == (1.7, 17.0, Pose2(1.0, 2.0, 0.5))
    np.testing.assert_array_equal(second.arrays["patch"], np.full((2, 3), 18, np.uint8))
    saved = store.localizer_map("laser").load("map")
    assert {name: array.tolist() for name, array in saved.items()} == {"points": [1.5, -2.0], "count": 2}
    assert [store.is_finished(owner) for owner in store.owners()] == [False, True]
    assert store.sensors() == {"floor": SensorInfo("floor", "image")}
    assert store.meta() == {"trailmark": "0.0.1"}


def test_an_older_store_is_read_and_not_changed(old: Path, place: SimpleNamespace) -> None:
    before = old.read_bytes()

    with place.opened(old) as store:
        check_contents(store)

    assert old.read_bytes() == before
    assert os.listdir(old.parent) == ["old.trail"]


def test_an_older_store_is_migrated_when_teaching_goes_on(old: Path, place: SimpleNamespace) -> None:
    with place.opened(old, "append") as store:
        check_contents(store)
        store.localizer_map("floor").add(place.keyframe(2))
        store.commit()

    with closing(sqlite3.connect(old)) as connection:
        assert connection.execute("PRAGMA user_version").fetchone() == (2,)
    with place.opened(old) as store:
        assert len(store.localizer_map("floor").keyframes()) == 3
    assert check_store(old).is_sound


def test_info_names_the_schema_of_the_file(old: Path) -> None:
    assert describe_store(old)["schema"] == 1


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE arrays SET dtype = 'object' WHERE name = 'patch'",
        "UPDATE arrays SET shape = '2,x' WHERE name = 'patch'",
        "UPDATE arrays SET shape = '99999999' WHERE name = 'patch'",
        "UPDATE arrays SET data = 3 WHERE name = 'patch'",
        "UPDATE waypoints SET x = 'far'",
        "UPDATE waypoints SET idx = 7 WHERE idx = 2",
        "UPDATE waypoints SET station_m = NULL",
        "UPDATE keyframes SET stamp_s = 9e999",
        "UPDATE facts SET value = '{'",
        "UPDATE facts SET key = x'00' WHERE key = 'meta'",
        "UPDATE drawers SET owner = x'00' WHERE id = 5",
    ],
)
def test_an_older_store_that_is_damaged_is_left_as_it_is(old: Path, place: SimpleNamespace, statement: str) -> None:
    with closing(sqlite3.connect(old)) as connection:
        connection.execute(statement)
        connection.commit()
    before = old.read_bytes()

    for access in ("read", "append"):
        with pytest.raises(StoreError), place.opened(old, access) as store:
            store.sensors()
    assert old.read_bytes() == before
