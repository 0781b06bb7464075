"""Pipes: a reader that goes away is a quiet end, and a named pipe is not waited for."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from trailmark.cli.guess import guess_config
from trailmark.errors import ConfigError, PluginError
from trailmark.plugins import load_plugins
from trailmark.plugins.candidates import Selection
from trailmark.plugins.loader import discover_plugins

TRAILMARK = f"{sys.executable} -m trailmark.cli"


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    path = tmp_path / "w.csv"
    path.write_text("t,x,y,theta\n" + "".join(f"{i / 10},{i * 0.03},0,0\n" for i in range(50)))
    return path


@pytest.fixture
def run_folder(drive: Path, tmp_path: Path) -> Path:
    import trailmark

    source = {"plugin": "csv_odometry", "path": str(drive)}
    trailmark.run({"sources": {"w": source}, "localizers": {"odometry": {"plugin": "odometry"}}}, tmp_path / "run")
    return tmp_path / "run"


def shell(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a line of bash; the exit code is that of the first program of its pipe."""
    return subprocess.run(
        ["bash", "-c", f"{line}; exit ${{PIPESTATUS[0]}}"], cwd=folder, capture_output=True, text=True, timeout=100
    )


@pytest.mark.skipif(os.name != "posix", reason="a shell's pipes")
@pytest.mark.parametrize(
    ("command", "reader"),
    [
        ("run w.csv --localizer odometry --out out --no-report", "true"),
        ("run w.csv --localizer odometry --out out --no-report --json", "head -n 1"),
        ("compare run", "true"),
        ("evaluate run/trajectories/fused.tum run/trajectories/odometry.tum", "true"),
        ("inspect w.csv", "true"),
        ("plugins", "true"),
        ("schema", "head -c 1"),
        ("--help", "true"),
        ("doctor", "head -n 1"),
    ],
)
def test_a_reader_that_goes_away_is_a_quiet_end(command: str, reader: str, run_folder: Path) -> None:
    done = shell(f"{TRAILMARK} {command} | {reader}", run_folder.parent)

    assert (done.returncode, done.stderr) == (0, "")
    if command.startswith("run"):
        assert (run_folder.parent / "out/trajectories/fused.tum").stat().st_size > 0


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
@pytest.mark.parametrize("command", ["evaluate f", "run f", "run w.csv --calibration=f"])
def test_a_named_pipe_is_refused_and_not_waited_for(command: str, drive: Path) -> None:
    os.mkfifo(drive.parent / "f")
    done = subprocess.run(
        [sys.executable, "-m", "trailmark.cli", *command.split()],
        cwd=drive.parent,
        capture_output=True,
        text=True,
        timeout=60,
    )

    assert done.returncode == 2
    assert "f is a named pipe, not a file" in done.stderr


def test_a_plugin_that_may_not_load_is_named_where_it_may_be_missing(drive: Path) -> None:
    few = discover_plugins(Selection(allowed=frozenset({"sim"}))).registry
    with pytest.raises(ConfigError, match=r"no source opens .*w.csv; .*datasets.* may not load .*TRAILMARK_PLUGINS"):
        guess_config(str(drive), few)
    with pytest.raises(PluginError, match=r"no source named 'csv_odometry'.*datasets.* may not load"):
        few.find("source", "csv_odometry")

    blocked = load_plugins().restricted(block=["datasets"]).registry
    with pytest.raises(ConfigError, match=r"datasets may not load \(blocked\)"):
        guess_config(str(drive), blocked)
