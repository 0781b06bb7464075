"""Teaching a path and driving it again from the command line, in the simulator, with a small camera."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import trailmark
from trailmark.geometry import Trajectory, read_tum
from trailmark.pipeline import RunResult
from trailmark_papers.kit import keyframes_of

CONFIG = """
sources:
  floor:
    plugin: sim
    world: ground_course
    route: straight
    sensors: [floor]
    duration_s: 3.5
    options: {camera: {width: 320, height: 288, field_mm: [125.0, 112.5]}}
localizers:
  floor: {plugin: ground_vo, n_pixels: 384}
  floor_map: {plugin: ground_map, search: pyramid}
controller: {plugin: path_tracking_4ws}
"""
#: Half a minute is more than any playback takes; the path ends at 0.85 m.
PLAYBACK = ("sources.floor.duration_s=30",)
END_M = 0.85


def command_line(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "trailmark.cli", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)


@pytest.fixture(scope="module")
def taught(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which 0.85 m were taught."""
    folder = tmp_path_factory.mktemp("taught")
    (folder / "config.yaml").write_text(CONFIG, encoding="utf-8")
    done = command_line(folder, "teach", "config.yaml", "--store", "path.trail", "--out", "teach")
    assert done.returncode == 0, done.stderr
    return folder


def replay(taught: Path, *overrides: str) -> tuple[RunResult, Trajectory]:
    """Drive the path; return what became of it, and where the vehicle truly went."""
    result = trailmark.run(
        taught / "config.yaml", taught / "replay", store=taught / "path.trail", mode="replay",
        overrides=[*PLAYBACK, *overrides], overwrite=True, report=False,
    )  # fmt: skip
    assert result.ground_truth is not None
    return result, result.ground_truth


def test_one_way_is_driven_and_it_stops_at_the_end(taught: Path) -> None:
    result, truth = replay(taught)

    assert (result.status, result.reason) == ("done", "the end of the path is reached")
    np.testing.assert_allclose(truth.positions[-1], (END_M, 0.0), atol=0.01)
    assert truth.positions[-1, 0] - truth.positions[-30, 0] < 0.07  # it has braked: at full speed 0.11


def test_at_the_end_it_drives_back_without_being_told(taught: Path) -> None:
    _, truth = replay(taught, "start=last")

    np.testing.assert_allclose(truth.positions[0], (END_M, 0.0), atol=0.01)
    np.testing.assert_allclose(truth.positions[-1], (0.0, 0.0), atol=0.01)
    assert np.abs(truth.headings).max() < 0.05  # backwards, not turned


def test_from_the_command_line_it_reverses_and_repeats_round_trips(taught: Path) -> None:
    asked = ("replay", "config.yaml", "--store", "path.trail", "--reverse", "--repeat", "1.5", "--out", "there")

    done = command_line(taught, *asked, "--set", *PLAYBACK)

    assert done.returncode == 0, done.stderr
    truth = read_tum(taught / "there" / "trajectories" / "groundtruth.tum")
    turns = np.flatnonzero(np.diff(np.sign(np.diff(truth.positions[::20, 0]))))
    assert len(turns) == 2
    np.testing.assert_allclose(truth.positions[20 * (turns + 1), 0], (0.0, END_M), atol=0.02)
    np.testing.assert_allclose(truth.positions[-1], (0.0, 0.0), atol=0.01)


def test_a_robot_that_finds_no_patch_stops_within_the_distance_that_was_set(taught: Path) -> None:
    carpet = "sources.floor.options.covered=[{from_m: 0.3, to_m: 2.0, floor: carpet}]"

    result, truth = replay(taught, carpet, "stop_when.fix_age_m=0.15")

    assert result.status == "stopped"
    assert "stop_when.fix_age_m: 0.15" in result.reason
    # The last patch that is found lies before the carpet or half on it (17 mm); then it rolls out, 0.15 s long.
    assert 0.25 + 0.15 < truth.positions[-1, 0] < 0.32 + 0.15 + 0.05
    assert np.ptp(truth.poses[-100:], axis=0).max() < 1e-6


def test_a_path_can_be_taught_by_hand(taught: Path, tmp_path: Path) -> None:
    pty = pytest.importorskip("pty", reason="no terminals of this kind on this system")
    far, near = pty.openpty()
    command = [sys.executable, "-m", "trailmark.cli", "teach", "config.yaml", "--store", str(tmp_path / "hand.trail")]
    command += ["--out", str(tmp_path / "out"), "--set", "sources.floor.driver=keyboard", "--set", "pace=realtime"]
    command += ["--set", PLAYBACK[0]]
    process = subprocess.Popen(command, cwd=taught, stdin=near, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    try:
        assert process.stderr is not None
        assert any(b"drive with the keys" in line for line in process.stderr)
        for keys, n_pictures in ((b"wwww", 30), (b"a", 100), (b"c", 140), (b" ", 160), (b"q", 0)):
            os.write(far, keys)
            wait_for(tmp_path / "out" / "estimates.csv", n_pictures)
        assert process.wait(timeout=60) == 0
    finally:
        process.kill()
        process.wait()
        os.close(far)
        os.close(near)

    assert len(keyframes_of(tmp_path / "hand.trail", "floor_map")) >= 4
    truth = read_tum(tmp_path / "out" / "trajectories" / "groundtruth.tum")
    assert truth.headings[-1] > 0.01  # it was steered to the left


def wait_for(table: Path, n_rows: int) -> None:
    """Wait until a run has written so many rows: however slow the machine is."""
    deadline_s = time.monotonic() + 100.0
    while n_rows and time.monotonic() < deadline_s:
        if table.is_file() and table.read_bytes().count(b"\n") >= n_rows:
            return
        time.sleep(0.05)
