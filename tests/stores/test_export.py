"""Export to ordinary files, which never leave their folder."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.errors import StoreError
from trailmark.geometry import read_tum
from trailmark.stores.export import export_store, file_names


def test_everything_is_found_again_in_the_files(taught: Path, tmp_path: Path, place: SimpleNamespace) -> None:
    folder = tmp_path / "out"

    files = export_store(taught, folder)

    assert sorted(files) == sorted(path for path in folder.rglob("*") if path.is_file())
    path = read_tum(folder / "path.tum")
    np.testing.assert_allclose(path.stamps_s, 0.05 * np.arange(12), atol=1e-9)
    with (folder / "waypoints.csv").open() as file:
        rows = list(csv.DictReader(file))
    waypoint = place.waypoint(7)
    assert {key: float(value) for key, value in rows[7].items()} == {
        "index": 7.0,
        "station_m": waypoint.station_m,
        "x": waypoint.pose_map_base.x,
        "y": waypoint.pose_map_base.y,
        "theta": waypoint.pose_map_base.theta,
    }
    with np.load(folder / "drawers" / "floor" / "keyframes.npz", allow_pickle=False) as keyframes:
        np.testing.assert_array_equal(keyframes["000003.patch"], place.keyframe(3).arrays["patch"])
        assert keyframes["stamp_s"][3] == place.keyframe(3).stamp_s
        assert keyframes["pose_map_base"].shape == (12, 3)
    with np.load(folder / "drawers" / "laser" / "saved" / "map.npz", allow_pickle=False) as saved:
        np.testing.assert_array_equal(saved["points"], np.arange(40.0).reshape(20, 2))
    assert json.loads((folder / "sensors.json").read_text())["floor"]["rate_hz"] == 70.0
    assert json.loads((folder / "provenance.json").read_text()) == place.META


def test_the_same_store_gives_the_same_bytes(taught: Path, tmp_path: Path) -> None:
    first = {path.name: path.read_bytes() for path in export_store(taught, tmp_path / "a")}
    second = {path.name: path.read_bytes() for path in export_store(taught, tmp_path / "b")}

    assert first == second


def test_an_empty_store_exports_empty_tables(tmp_path: Path, place: SimpleNamespace) -> None:
    with place.opened(tmp_path / "a.trail", "create") as store:
        store.commit()

    export_store(tmp_path / "a.trail", tmp_path / "out")

    assert len(read_tum(tmp_path / "out" / "path.tum")) == 0


def test_hostile_names_stay_in_the_folder(tmp_path: Path, place: SimpleNamespace) -> None:
    names = ["../../evil", "/etc/passwd", "..", ".", "a/b", "a\\b", "~", "con", "A", "a", "ü" * 150, "keyframes.npz"]
    with place.opened(tmp_path / "a.trail", "create") as store:
        for name in names:
            store.localizer_map(name).save(name, {name: np.arange(3)})
            store.localizer_map("floor").save(name, {other: np.arange(3) for other in names})
        store.commit()
    folder = tmp_path / "deep" / "out"

    files = export_store(tmp_path / "a.trail", folder)

    assert len(files) == len(set(files)) == 4 + 2 * len(names) + 1 + len(names)
    assert all(path.resolve().is_relative_to(folder.resolve()) for path in files)
    assert sorted(os.listdir(tmp_path)) == ["a.trail", "deep"]
    assert os.listdir(tmp_path / "deep") == ["out"]
    with np.load(folder / "drawers" / "floor" / "saved" / "A.npz", allow_pickle=False) as saved:
        assert len(saved.files) == len(names)
        assert not any("/" in name or name.startswith(".") for name in saved.files)


@given(st.lists(st.text(max_size=300), max_size=20))
def test_file_names_are_plain_and_no_two_are_the_same(names: list[str]) -> None:
    found = file_names(names)

    assert len({name.lower() for name in found}) == len(names)
    assert all(name and len(name) < 100 and set(name) <= PLAIN for name in found)


PLAIN = set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-")


def test_a_folder_that_holds_something_is_refused(taught: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "thesis.txt").write_text("years of work")

    with pytest.raises(StoreError, match=r"out is not empty; name a new folder"):
        export_store(taught, folder)
    assert os.listdir(folder) == ["thesis.txt"]


def test_a_folder_that_cannot_be_made_is_named(taught: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")

    with pytest.raises(StoreError, match="cannot export to"):
        export_store(taught, tmp_path / "file" / "out")


def test_a_missing_store_makes_no_folder(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="no path store"):
        export_store(tmp_path / "a.trail", tmp_path / "out")
    assert os.listdir(tmp_path) == []
