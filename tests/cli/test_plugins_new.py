"""``trailmark plugins new``: what it writes installs without a network and passes its own tests."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

PARTS = (
    "--localizer", "--camera", "--places", "--source", "--robot", "--dataset", "--controller", "--sink", "--metric",
)  # fmt: skip

#: Writes a recording to a path, as the tests of the template do.
WRITE_RECORDING = """
import sys
from pathlib import Path
sys.path.insert(0, "tests")
from test_dataset import write_recording
write_recording(Path(sys.argv[1]))
"""


class Made(NamedTuple):
    """A distribution with every part, and the folder that it is installed in."""

    folder: Path
    site: Path

    def run(self, *command: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        """Run python as somebody who has installed it."""
        environment = os.environ | {"PYTHONPATH": str(self.site)}
        environment.pop("PYTEST_ADDOPTS", None)
        return subprocess.run(
            [sys.executable, *map(str, command)],
            cwd=cwd or self.folder, env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A distribution with every part, written and installed as a user would, without a network."""
    work = tmp_path_factory.mktemp("new")
    made = Made(work / "trailmark-my-gyro", work / "site")
    written = made.run("-m", "trailmark.cli", "plugins", "new", "my_gyro", *PARTS, cwd=work)
    assert written.returncode == 0, written.stderr
    options = ("-q", "--no-index", "--no-deps", "--no-build-isolation", "--target", made.site)
    installed = made.run("-m", "pip", "install", *options, made.folder, cwd=work)
    assert installed.returncode == 0, installed.stderr
    return made


@pytest.mark.slow
def test_a_distribution_with_every_part_passes_its_tests(made: Made) -> None:
    tested = made.run("-m", "pytest", "-q", "-p", "no:cacheprovider")

    assert tested.returncode == 0, tested.stdout
    assert "passed" in tested.stdout


@pytest.mark.slow
def test_every_part_is_listed_under_a_name_of_its_own(made: Made) -> None:
    listed = json.loads(made.run("-m", "trailmark.cli", "plugins", "--json").stdout)

    (own,) = [record for record in listed if record["distribution"] == "trailmark-my-gyro"]
    assert len({(part["kind"], part["name"]) for part in own["parts"]}) == len(PARTS)


@pytest.mark.slow
def test_ruff_finds_nothing(made: Made) -> None:
    linted = made.run("-m", "ruff", "check", "--no-cache", ".")

    assert linted.returncode == 0, linted.stdout


@pytest.mark.long  # 8 s of CPU: mypy reads numpy and pydantic anew
def test_the_types_are_strict(made: Made, tmp_path: Path) -> None:
    checked = made.run("-m", "mypy", "--strict", "--cache-dir", tmp_path, "src", "tests")

    assert checked.returncode == 0, checked.stdout


@pytest.mark.slow
def test_a_recording_is_taught_and_replayed_with_the_parts(made: Made, tmp_path: Path) -> None:
    """The data set, wheels and laser, the localizer that knows the way by its map, and a sink, in one run."""
    assert made.run("-c", WRITE_RECORDING, tmp_path / "room.my_gyro").returncode == 0
    (tmp_path / "drive.yaml").write_text(
        """
        sources: {room: {plugin: my_gyro_dataset, path: room.my_gyro}}
        localizers: {wheels: {plugin: my_gyro}, places: {plugin: my_gyro_places}}
        estimator: {plugin: kalman}
        sinks: [{plugin: my_gyro, to: poses.csv}]
        """
    )

    for command in ("teach", "replay"):
        options = ("--store", "room.trail", "--out", command, "--no-report")
        done = made.run("-m", "trailmark.cli", command, "drive.yaml", *options, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert "WARNING" not in done.stderr

    counted = json.loads((tmp_path / "replay" / "run.json").read_text())["counters"]
    assert counted["localizer.places.accepted"] == 31
    assert len((tmp_path / "poses.csv").read_text().splitlines()) > 61


def test_a_localizer_is_written_unless_told_otherwise(trailmark, tmp_path) -> None:
    trailmark("plugins", "new", "gyro", "--into", tmp_path / "mine")

    package = tmp_path / "mine" / "trailmark-gyro" / "src" / "trailmark_gyro"
    assert {path.name for path in package.iterdir()} == {
        "__init__.py", "plugin.py", "localizer.py", "localizer_config.py", "py.typed",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("My-Gyro", "'My-Gyro' is no name for a plugin: use lower-case letters"),
        ("2d_laser", "such as 'd_laser'"),
        ("../escape", "such as 'escape'"),
        ("a__b", "such as 'a_b'"),
        ("null", "is a value in configs, not a word; use another, such as 'my_null'"),
        ("on", "is a value in configs"),
        ("con", "is a device on Windows"),
        ("lambda", "is a word of Python"),
        ("ground_vo", "'ground_vo' is taken: the package trailmark_ground_vo is installed already"),
    ],
)
def test_a_name_that_is_none_is_refused(trailmark, tmp_path, name, complaint) -> None:
    done = trailmark("plugins", "new", name)

    assert done.returncode == 2
    assert complaint in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_is_not_overwritten(trailmark, tmp_path) -> None:
    (tmp_path / "trailmark-gyro").mkdir()

    done = trailmark("plugins", "new", "gyro")

    assert done.returncode == 2
    assert "is there already" in done.stderr
    assert list((tmp_path / "trailmark-gyro").iterdir()) == []
