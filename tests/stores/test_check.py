"""The check reads on behind what is damaged, and says what is left."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from trailmark.errors import StoreError
from trailmark.stores.check import check_store


def edit(path: Path, *statements: str) -> None:
    with closing(sqlite3.connect(path)) as connection:
        for statement in statements:
            connection.execute(statement)
        connection.commit()


def test_a_sound_store_is_read_to_the_last_row(taught: Path) -> None:
    findings = check_store(taught)

    assert findings.is_sound
    assert findings.readable == {
        "entries": (3, 3),
        "waypoints": (12, 12),
        "drawers": (2, 2),
        "keyframes of floor": (12, 12),
        "keyframes of laser": (0, 0),
        "saved of floor": (0, 0),
        "saved of laser": (1, 1),
    }


def test_damaged_rows_are_named_and_the_rest_is_counted(taught: Path) -> None:
    edit(
        taught,
        "UPDATE keyframes SET x = 5 WHERE number IN (3, 7)",
        "UPDATE waypoints SET y = 5 WHERE id = 2",
        "UPDATE saved SET data = x'00'",
        "UPDATE facts SET value = '{' WHERE key = 'meta'",
    )

    findings = check_store(taught)

    assert findings.readable["keyframes of floor"] == (10, 12)
    assert findings.readable["waypoints"] == (11, 12)
    assert findings.readable["saved of laser"] == (0, 1)
    text = "\n".join(findings.problems)
    for named in ("keyframe 3 of 'floor'", "keyframe 7 of 'floor'", "waypoint 2", "'map' of 'laser'", "entry 'meta'"):
        assert f"{named} is not as it was written" in text


def test_a_page_that_is_rubbish_costs_its_own_rows_only(taught: Path) -> None:
    raw = bytearray(taught.read_bytes())
    (place,) = [i for i in range(0, len(raw), 1024) if is_leaf_with_waypoints(raw, i)]
    raw[place : place + 8] = b"\xff" * 8
    taught.write_bytes(raw)

    findings = check_store(taught)

    assert not findings.is_sound
    assert findings.readable["keyframes of floor"] == (12, 12)
    assert findings.readable["waypoints"] == (0, 12)


def is_leaf_with_waypoints(raw: bytearray, start: int) -> bool:
    is_leaf, n_cells = raw[start] == 13, int.from_bytes(raw[start + 3 : start + 5], "big")
    return is_leaf and n_cells == 12  # the keyframes take several pages


def test_damage_in_a_chain_of_pages_costs_one_keyframe(taught: Path) -> None:
    raw = bytearray(taught.read_bytes())
    patch = np.random.default_rng(5).integers(0, 256, (44, 44), dtype=np.uint8).tobytes()  # of keyframe 5
    start = raw.index(patch[100:500]) // 1024 * 1024
    raw[start : start + 4] = (0xFFFFFF).to_bytes(4, "big")  # where the chain goes on
    taught.write_bytes(raw)

    findings = check_store(taught)

    assert findings.readable["keyframes of floor"] == (11, 12)
    assert findings.readable["waypoints"] == (12, 12)


def test_long_lists_of_problems_are_cut(taught: Path) -> None:
    edit(taught, *["UPDATE keyframes SET x = 5"] * 1)
    findings = check_store(taught)
    for number in range(100):
        findings.add(f"problem {number}")

    assert len(findings.problems) == 50
    assert findings.n_more == 100 + 13 - 50  # 12 keyframes, and the line that counts them


def test_tables_that_are_not_ours_leave_nothing_to_read(taught: Path) -> None:
    edit(taught, "DROP TABLE saved")

    findings = check_store(taught)

    assert findings.readable == {}
    assert "its tables are not those of schema 2" in findings.problems[0]


def test_what_is_no_store_at_all_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("dear diary")
    (tmp_path / "empty.trail").touch()
    messages = {
        "notes.txt": "is not a path store",
        "nothing.trail": "no path store at",
        "empty.trail": "is not a path store but an empty file",
    }
    for name, message in messages.items():
        with pytest.raises(StoreError, match=message):
            check_store(tmp_path / name)
