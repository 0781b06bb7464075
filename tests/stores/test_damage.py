"""Files that are not as they were written, and disks that do not take what is written."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from trailmark.errors import StoreError
from trailmark.stores.check import check_store
from trailmark.stores.rows import checksum

IS_FULL = os.environ.get("TRAILMARK_TRUST") == "full"  # `make trust`
N_FLIPS = 500 if IS_FULL else 100
N_CUTS = 100 if IS_FULL else 25


def edited(path: Path, *statements: str) -> None:
    """Change a store behind its back."""
    with closing(sqlite3.connect(path)) as connection:
        for statement in statements:
            connection.execute(statement)
        connection.commit()


def test_a_flipped_bit_is_an_error_or_harmless_and_never_silent(
    taught: Path, place: SimpleNamespace, record_property: Callable[[str, object], None]
) -> None:
    record_property("stores with a flipped bit, read", N_FLIPS)
    expected, raw = place.contents(taught), taught.read_bytes()
    rng = np.random.default_rng(7)
    n_noticed = 0

    for position in rng.integers(0, 8 * len(raw), N_FLIPS):
        flipped = bytearray(raw)
        flipped[position // 8] ^= 1 << (position % 8)
        taught.write_bytes(flipped)
        try:
            assert place.contents(taught) == expected, f"bit {position} changed what is read"
        except StoreError:
            n_noticed += 1

    assert n_noticed > N_FLIPS // 2  # the file is mostly patches, and all of these are covered


def test_a_flipped_bit_in_a_large_store_is_noticed_row_by_row(
    taught: Path,
    place: SimpleNamespace,
    monkeypatch: pytest.MonkeyPatch,
    record_property: Callable[[str, object], None],
) -> None:
    monkeypatch.setattr("trailmark.stores.files._QUICK_CHECK_BYTES", 0)  # as for a file too large to check as a whole
    test_a_flipped_bit_is_an_error_or_harmless_and_never_silent(taught, place, lambda name, value: None)
    record_property("stores with a flipped bit, read row by row", N_FLIPS)


def test_a_store_with_a_flipped_bit_is_taught_on_or_refused(taught: Path, place: SimpleNamespace) -> None:
    raw = taught.read_bytes()
    rng = np.random.default_rng(11)

    for position in rng.integers(0, 8 * len(raw), N_FLIPS // 2):
        flipped = bytearray(raw)
        flipped[position // 8] ^= 1 << (position % 8)
        taught.write_bytes(flipped)
        try:
            with place.opened(taught, "append") as store:
                place.teach(store, 1, start=12)
                store.mark_finished("laser")
                store.commit()
        except StoreError:
            continue
        with place.opened(taught) as store:
            assert store.is_finished("laser")


def test_no_flip_in_the_head_of_the_file_passes_silently(taught: Path, place: SimpleNamespace) -> None:
    expected, raw = place.contents(taught), taught.read_bytes()

    for position in range(0, 8 * 100, 3):
        flipped = bytearray(raw)
        flipped[position // 8] ^= 1 << (position % 8)
        taught.write_bytes(flipped)
        try:
            assert place.contents(taught) == expected
        except StoreError:
            continue


def test_a_file_cut_anywhere_is_an_error(
    taught: Path, place: SimpleNamespace, record_property: Callable[[str, object], None]
) -> None:
    record_property("stores cut at a random place, read and gone on with", N_CUTS)
    raw = taught.read_bytes()

    for length in [0, 1, 99, 100, 1023, 1024, *np.random.default_rng(7).integers(0, len(raw), N_CUTS)]:
        taught.write_bytes(raw[:length])
        with pytest.raises(StoreError):
            place.contents(taught)
        with pytest.raises(StoreError), place.opened(taught, "append"):
            pass


@pytest.mark.parametrize(
    "content", [b"", b"junk", b"SQLite format 3\0" + bytes(84), b"\x89PNG\r\n\x1a\n" + bytes(5000), b"\0" * 4096]
)
@pytest.mark.parametrize("access", ["read", "append"])
def test_a_foreign_file_is_refused_and_left_alone(
    tmp_path: Path, place: SimpleNamespace, content: bytes, access: str
) -> None:
    path = tmp_path / "foreign.trail"
    path.write_bytes(content)

    with pytest.raises(StoreError, match="is not a path store"), place.opened(path, access):
        pass
    assert path.read_bytes() == content
    assert os.listdir(tmp_path) == ["foreign.trail"]


@pytest.mark.parametrize("access", ["read", "append"])
def test_another_programs_database_is_refused(tmp_path: Path, place: SimpleNamespace, access: str) -> None:
    path = tmp_path / "other.db"
    edited(path, "CREATE TABLE waypoints (id INTEGER PRIMARY KEY)")
    before = path.read_bytes()

    with pytest.raises(StoreError, match="is not a path store but another SQLite file"), place.opened(path, access):
        pass
    assert path.read_bytes() == before


@pytest.mark.parametrize("access", ["read", "append"])
def test_a_newer_schema_is_refused_with_what_to_do(taught: Path, place: SimpleNamespace, access: str) -> None:
    edited(taught, "PRAGMA user_version = 3")
    before = taught.read_bytes()

    with (
        pytest.raises(StoreError, match=r"newer Trailmark: it has schema 3.*Update Trailmark"),
        place.opened(taught, access),
    ):
        pass
    assert taught.read_bytes() == before


@pytest.mark.parametrize(
    "statement",
    [
        "CREATE TRIGGER t AFTER INSERT ON waypoints BEGIN DELETE FROM keyframes; END",
        "CREATE VIEW v AS SELECT * FROM waypoints",
        "CREATE TABLE extra (id INTEGER)",
        "CREATE INDEX i ON waypoints (x)",
        "DROP TABLE saved",
        "ALTER TABLE waypoints ADD COLUMN z REAL",
        "PRAGMA user_version = 0",
    ],
)
@pytest.mark.parametrize("access", ["read", "append"])
def test_a_store_with_other_tables_than_ours_is_refused(
    taught: Path, place: SimpleNamespace, statement: str, access: str
) -> None:
    edited(taught, statement)

    with pytest.raises(StoreError, match="is damaged"), place.opened(taught, access):
        pass


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("UPDATE waypoints SET x = x + 1 WHERE id = 3", "waypoint 3 is not as it was written"),
        ("DELETE FROM waypoints WHERE id = 3", "waypoint 3 of 12 is missing"),
        ("DELETE FROM waypoints WHERE id = 11", "waypoint 11 of 12 is missing"),
        ("UPDATE waypoints SET station_m = 'far' WHERE id = 3", "waypoint 3"),
        ("UPDATE keyframes SET stamp_s = 0 WHERE number = 4", "keyframe 4 of 'floor' is not as it was written"),
        ("UPDATE keyframes SET layout = replace(layout, '44,44', '22,88')", "keyframe 0 of 'floor'"),
        ("DELETE FROM keyframes WHERE number = 11", "keyframe 11 of 'floor' is missing"),
        ("UPDATE keyframes SET drawer = 1 WHERE number = 4", "keyframe"),
        ("UPDATE drawers SET finished = 1 WHERE owner = 'floor'", "drawer 'floor' is not as it was written"),
        ("DELETE FROM drawers WHERE owner = 'laser'", "2 drawers should be there"),
        ("INSERT INTO drawers SELECT 2, owner, 0, 0, 0, 0 FROM drawers LIMIT 1", "drawer"),
        ("UPDATE saved SET data = zeroblob(length(data))", "'map' of 'laser' is not as it was written"),
        ("DELETE FROM saved", "'laser' has saved 1 sets of arrays, but 0 are there"),
        ("UPDATE facts SET value = '{}' WHERE key = 'sensors'", "'sensors' is not as it was written"),
        ("INSERT INTO facts SELECT NULL, key, crc, value FROM facts WHERE key = 'meta'", "'meta' is there twice"),
        ("DELETE FROM facts WHERE key = 'totals'", "does not say how many"),
        ("UPDATE facts SET key = 'wensors' WHERE key = 'sensors'", "'wensors' is not as it was written"),
        ("DELETE FROM facts WHERE key = 'sensors'", "'sensors' may be lost: an entry is missing"),
        ("UPDATE saved SET name = 'mop'", "'mop' of 'laser' is not as it was written"),
        ("UPDATE facts SET value = CAST(x'ff' AS TEXT) WHERE key = 'meta'", "is damaged"),
    ],
)
def test_a_changed_row_is_named(taught: Path, place: SimpleNamespace, statement: str, message: str) -> None:
    edited(taught, statement)

    with pytest.raises(StoreError, match=f"place.trail is damaged: .*{message}|is damaged.*UTF-8"):
        place.contents(taught)


@pytest.mark.parametrize("value", ['{"floor": {"name": "Floor", "kind": "image"}}', "[" * 50_000, "[]", "3", "1e999"])
def test_a_right_checksum_does_not_make_a_hostile_entry_right(taught: Path, place: SimpleNamespace, value: str) -> None:
    with closing(sqlite3.connect(taught)) as connection:
        crc = checksum("facts", "sensors", value)
        connection.execute("UPDATE facts SET value = ?, crc = ? WHERE key = 'sensors'", (value, crc))
        connection.commit()

    with pytest.raises(StoreError):
        place.contents(taught)
    assert not check_store(taught).is_sound


def test_a_right_checksum_does_not_make_a_hostile_keyframe_right(taught: Path, place: SimpleNamespace) -> None:
    values = (0, 0, float("inf"), 1.0, 0.0, 0.0, 0.0)
    for layout in ('[["a","uint8",[4611686018427387904]]]', "[]"):
        with closing(sqlite3.connect(taught)) as connection:
            crc = checksum("keyframes", *values, layout, b"")
            connection.execute(
                "UPDATE keyframes SET station_m = ?, stamp_s = 1.0, x = 0, y = 0, theta = 0, layout = ?, data = x'',"
                " crc = ? WHERE number = 0",
                (values[2], layout, crc),
            )
            connection.commit()
        with pytest.raises(StoreError, match="keyframe 0 of 'floor' cannot be read"):
            place.contents(taught)


def test_a_full_store_keeps_what_was_committed(taught: Path, place: SimpleNamespace) -> None:
    with place.opened(taught, "append") as store:
        with store._database.writing() as connection:
            (pages,) = connection.execute("PRAGMA page_count").fetchone()
            connection.execute(f"PRAGMA max_page_count = {pages + 20}")
        with pytest.raises(StoreError, match=r"the disk is full, .* cannot grow; what was committed before is kept"):
            place.teach(store, 30, start=12)
        with pytest.raises(StoreError, match="the disk is full"):  # also later: half a path is no path
            store.commit()
        n_committed = len(store.path())
    assert 12 < n_committed < 42
    with place.opened(taught) as store:
        assert len(store.path()) == n_committed
    assert check_store(taught).is_sound


def test_a_new_store_that_finds_no_room_leaves_nothing_behind(
    taught: Path, place: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(connection: sqlite3.Connection) -> None:
        connection.execute("PRAGMA max_page_count = 2")
        connection.execute("CREATE TABLE a (x)")
        connection.execute("CREATE TABLE b (x)")

    before = place.contents(taught)
    monkeypatch.setattr("trailmark.stores.database.create_schema", fail)

    with pytest.raises(StoreError, match="the disk is full"), place.opened(taught, "overwrite"):
        pass
    assert os.listdir(taught.parent) == [taught.name]
    assert place.contents(taught) == before


LIMITED = """
import resource, signal, sys
sys.path.insert(0, sys.argv[1])
from conftest import opened, teach
from trailmark.errors import StoreError
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, 150_000))
from pathlib import Path
try:
    with opened(Path(sys.argv[2]), "append") as store:
        for index in range(12, 1000):
            teach(store, 1, index)
            print(index + 1, flush=True)
except StoreError as error:
    print(error, file=sys.stderr)
    sys.exit(2)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="file size limits are POSIX")
def test_a_disk_that_takes_no_more_ends_in_one_clear_line(taught: Path, place: SimpleNamespace) -> None:
    command = [sys.executable, "-c", LIMITED, str(Path(__file__).parent), str(taught)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)

    assert result.returncode == 2, result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert "what was committed before is kept" in result.stderr
    with place.opened(taught) as store:
        assert len(store.path()) >= int(result.stdout.split()[-1]) > 12
    assert check_store(taught).is_sound
