"""``trailmark plugins new``: what it writes installs without a network and passes its own tests."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

PARTS = ("--localizer", "--source", "--robot", "--controller", "--sink", "--metric")


def python(*arguments: str | Path, cwd: Path, path: Path | None = None) -> subprocess.CompletedProcess[str]:
    environment = os.environ | ({"PYTHONPATH": str(path)} if path else {})
    environment.pop("PYTEST_ADDOPTS", None)
    command = [sys.executable, "-m", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_a_distribution_with_every_part_installs_and_passes_its_tests(trailmark, tmp_path) -> None:
    written = trailmark("plugins", "new", "my_gyro", *PARTS)
    folder, site = tmp_path / "trailmark-my-gyro", tmp_path / "site"

    assert written.returncode == 0, written.stderr
    install = python(
        "pip", "install", "-q", "--no-index", "--no-deps", "--no-build-isolation", "--target", site, folder,
        cwd=tmp_path,
    )  # fmt: skip
    assert install.returncode == 0, install.stderr
    tested = python("pytest", "-q", "-p", "no:cacheprovider", cwd=folder, path=site)
    assert tested.returncode == 0, tested.stdout
    assert "passed" in tested.stdout
    listed = python("trailmark.cli", "plugins", cwd=tmp_path, path=site)
    assert listed.stdout.count("my_gyro (trailmark-my-gyro 0.1.0)") == len(PARTS)
    linted = python("ruff", "check", "--no-cache", ".", cwd=folder)
    assert linted.returncode == 0, linted.stdout


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
