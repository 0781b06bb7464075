"""Copies of a store that is being taught: whole by ``store copy``, and said to be old where the log was left behind."""

from __future__ import annotations

import logging
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from trailmark.cli.store import store_group
from trailmark.errors import StoreError
from trailmark.stores.check import check_store
from trailmark.stores.copying import copy_store


def test_a_copy_of_a_live_store_holds_every_commit(tmp_path: Path, place: SimpleNamespace) -> None:
    live, copy = tmp_path / "live.trail", tmp_path / "copy.trail"
    with place.opened(live, "create") as store:
        place.teach(store, 230)

        assert copy_store(live, copy) == 230
        place.teach(store, 5, start=230)

    with place.opened(copy) as copied:
        assert len(copied.path().waypoints) == 230
    assert check_store(copy).is_sound
    assert sorted(file.name for file in tmp_path.iterdir()) == ["copy.trail", "live.trail"]


def test_a_file_that_was_copied_without_its_log_says_so_each_time(
    tmp_path: Path, place: SimpleNamespace, caplog: pytest.LogCaptureFixture
) -> None:
    live, copy = tmp_path / "live.trail", tmp_path / "copy.trail"
    with place.opened(live, "create") as store:
        place.teach(store, 50)
        shutil.copyfile(live, copy)

        for _ in range(2):
            caplog.clear()
            with caplog.at_level(logging.WARNING), place.opened(copy):
                pass
            assert "was not closed by its writer" in caplog.text
            (problem,) = check_store(copy).problems
            assert "its log is missing" in problem


def test_the_live_store_itself_and_one_left_by_a_reader_last_are_sound(
    tmp_path: Path, place: SimpleNamespace, caplog: pytest.LogCaptureFixture
) -> None:
    live = tmp_path / "live.trail"
    with place.opened(live, "create") as store:
        place.teach(store, 20)
        with caplog.at_level(logging.WARNING), place.opened(live):
            assert check_store(live).is_sound
        with place.opened(live) as reader:
            store.close()
            assert len(reader.path()) == 20
            assert check_store(live).is_sound

    assert check_store(live).is_sound
    assert not caplog.records


def test_the_command_copies_and_says_how_much(tmp_path: Path, place: SimpleNamespace) -> None:
    live, copy = tmp_path / "live.trail", tmp_path / "copy.trail"
    with place.opened(live, "create") as store:
        place.teach(store, 12)

    result = CliRunner().invoke(store_group, ["copy", str(live), str(copy)])

    assert (result.exit_code, result.output) == (0, f"{copy}: 12 waypoints\n")


def test_what_stands_at_the_target_is_not_overwritten_unasked(tmp_path: Path, place: SimpleNamespace) -> None:
    live, other = tmp_path / "live.trail", tmp_path / "other.trail"
    for path, count in ((live, 4), (other, 2)):
        with place.opened(path, "create") as store:
            place.teach(store, count)

    with pytest.raises(StoreError, match="exists already"):
        copy_store(live, other)
    assert copy_store(live, other, replaces=True) == 4
    with pytest.raises(StoreError, match="onto itself"):
        copy_store(live, live, replaces=True)


def test_a_stores_log_is_in_its_file_before_it_is_replaced(tmp_path: Path, place: SimpleNamespace) -> None:
    """A kill between removing the old log and putting the new file would lose what only the log holds."""
    path, old = tmp_path / "place.trail", tmp_path / "old.trail"
    with place.opened(path, "create") as store:
        place.teach(store, 60)
        for suffix in ("", "-wal"):  # as a killed writer leaves it
            shutil.copyfile(f"{path}{suffix}", f"{old}{suffix}")

    with place.opened(old, "overwrite"), closing(sqlite3.connect(f"file:{old}?immutable=1", uri=True)) as alone:
        assert alone.execute("SELECT count(*) FROM waypoints").fetchone() == (60,)


def test_an_old_store_whose_log_a_reader_holds_is_not_replaced(
    tmp_path: Path, place: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("trailmark.stores.writer._BUSY_S", 0.5)  # the reader does not go away by waiting
    path, old = tmp_path / "place.trail", tmp_path / "old.trail"
    with place.opened(path, "create") as store:
        place.teach(store, 10)
        shutil.copyfile(path, old)
        shutil.copyfile(f"{path}-wal", f"{old}-wal")
    with closing(sqlite3.connect(old, isolation_level=None)) as reader:
        reader.execute("BEGIN")
        reader.execute("SELECT count(*) FROM waypoints").fetchone()
        with closing(sqlite3.connect(old, isolation_level=None)) as writer:
            writer.execute("CREATE TABLE more (id)")

        with pytest.raises(StoreError, match="is being read"), place.opened(old, "overwrite"):
            pass
