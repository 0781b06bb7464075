"""``trailmark store info|check|export``."""

from __future__ import annotations

import json
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner, Result

from trailmark.cli.store import store_group
from trailmark.errors import StoreError


def run(*arguments: object) -> Result:
    return CliRunner().invoke(store_group, [str(argument) for argument in arguments])


def test_info_says_what_is_in_the_store(taught: Path) -> None:
    lines = run("info", taught).output.splitlines()

    assert lines[0].startswith(f"{taught}: ")
    assert lines[0].endswith("kB, schema 2")
    assert lines[1:] == [
        "path        12 waypoints over 0.55 m",
        "map         floor: 12 keyframes (23.5 kB), saved nothing (0 B), not finished",
        "map         laser: 0 keyframes (0 B), saved map (328 B), finished",
        "sensor      floor: image, 512 x 480 px, 70 Hz, calibrated",
        "provenance  trailmark: 0.1.0",
        'provenance  git: {"commit": "abc", "dirty": false}',
    ]


def test_info_as_json_holds_everything(taught: Path, place: SimpleNamespace) -> None:
    found = json.loads(run("info", taught, "--json").output)

    assert (found["waypoints"], found["length_m"], found["schema"]) == (12, pytest.approx(0.55), 2)
    assert found["bytes"] == taught.stat().st_size
    assert found["drawers"][0]["keyframe_bytes"] == 12 * (44 * 44 + 3 * 8)
    assert found["provenance"] == place.META
    assert found["sensors"]["floor"]["calibration"] == {"metres_per_pixel": [3.9e-4, 3.9e-4]}


def test_a_strangers_names_do_not_steer_the_terminal(tmp_path: Path, place: SimpleNamespace) -> None:
    path = tmp_path / "a.trail"
    with place.opened(path, "create") as store:
        store.set_meta({"\x1b[2J": "\x1b]0;owned\x07" * 50})
        store.commit()

    output = run("info", path).output

    assert "\x1b" not in output
    assert "\x07" not in output


def test_check_of_a_sound_store_succeeds(taught: Path) -> None:
    result = run("check", taught)

    assert result.exit_code == 0
    assert result.output.splitlines()[0] == f"{taught}: sound"
    assert "      12 of 12       keyframes of floor" in result.output


def test_check_of_a_damaged_store_says_what_can_still_be_read(taught: Path) -> None:
    with closing(sqlite3.connect(taught)) as connection:
        connection.execute("UPDATE keyframes SET x = 9 WHERE number = 4")
        connection.commit()

    result = run("check", taught)
    document = json.loads(run("check", taught, "--json").output)

    assert result.exit_code == 1
    assert result.output.splitlines()[0] == f"{taught}: damaged"
    assert "      11 of 12       keyframes of floor" in result.output
    assert "- keyframe 4 of 'floor' is not as it was written" in result.output
    assert document["sound"] is False
    assert document["readable"]["keyframes of floor"] == [11, 12]


def test_export_writes_into_a_folder_and_names_it(taught: Path, tmp_path: Path) -> None:
    result = run("export", taught, "--out", tmp_path / "out")
    listed = json.loads(run("export", taught, "--out", tmp_path / "again", "--json").output)

    assert result.output == f"7 files in {tmp_path / 'out'}\n"
    assert listed["folder"] == str(tmp_path / "again")
    assert all(Path(file).is_file() for file in listed["files"])


@pytest.mark.parametrize("command", ["info", "check", "export"])
def test_what_is_no_store_is_one_clear_error(tmp_path: Path, command: str) -> None:
    result = run(command, tmp_path / "missing.trail")

    assert isinstance(result.exception, StoreError)
    assert "no path store at" in str(result.exception)


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys, trailmark.cli.store\n"
        "print([name for name in ('numpy', 'cv2', 'trailmark.stores') if name in sys.modules])"
    )

    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert found.stdout == "[]\n"
