"""Any source to disk, and played again."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from trailmark.config import load_run_config
from trailmark.frames import Image, Odometry, Payload
from trailmark.frames.documents import calibration_to_document
from trailmark.pipeline import Pipeline
from trailmark.plugins import load_plugins

Run = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def drive(wheels_config: Path, tmp_path: Path) -> Path:
    """Wheels and a camera, and a localizer that is none of a recording's business."""
    rng = np.random.default_rng(7)
    (tmp_path / "pictures").mkdir()
    for number in range(5):
        cv2.imwrite(str(tmp_path / "pictures" / f"{number}.png"), rng.integers(0, 255, (12, 16)).astype(np.uint8))
    camera = "  front: {plugin: image_folder, path: pictures, rate_hz: 4, calibration: {metres_per_pixel: 1e-3}}\n"
    config = wheels_config.read_text().replace("localizers:", f"{camera}localizers:")
    wheels_config.write_text(config + "sensors: {front: {mounting: {x: 0.2, yaw_deg: 90}}}\n")
    return wheels_config


def frames_of(config: Path) -> list[tuple[str, float, bytes]]:
    """Return sensor, stamp and content of every frame of a config."""
    with Pipeline(config, overrides=["localizers={}"]) as pipeline:
        frames = [step.frame for step in pipeline if step.frame is not None]
    return [(frame.sensor, frame.stamp_s, content(frame.payload)) for frame in frames]


def content(payload: Payload) -> bytes:
    """Return what a frame holds, as bytes."""
    if isinstance(payload, Image):
        return payload.pixels.tobytes()
    assert isinstance(payload, Odometry)
    assert payload.pose_start_base is not None
    return payload.pose_start_base.array().tobytes()


def test_a_recording_plays_the_same_frames_again(trailmark: Run, drive: Path, tmp_path: Path) -> None:
    done = trailmark("record", drive, "--out", "set")

    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["     400 frames of wheels", "       5 frames of front", "set/config.yaml"]
    again = frames_of(tmp_path / "set" / "config.yaml")
    assert again == frames_of(drive)
    assert len(again) == 405


def test_mounting_calibration_and_truth_come_along(trailmark: Run, drive: Path, tmp_path: Path) -> None:
    assert trailmark("record", drive, "--out", "set", "--progress", "none").returncode == 0

    plugins = load_plugins()
    before, after = (load_run_config(path, plugins=plugins) for path in (drive, tmp_path / "set" / "config.yaml"))

    assert after.sensors["front"].mounting == before.sensors["front"].mounting
    taken, given = after.sensors["front"].calibration, before.sources["front"].calibration
    assert taken is not None
    assert given is not None
    assert calibration_to_document(taken) == calibration_to_document(given)
    truth = np.loadtxt(tmp_path / "set" / "groundtruth.tum")
    np.testing.assert_allclose(truth, np.loadtxt(tmp_path / "truth.tum"), atol=1e-8)


def test_a_file_is_recorded_without_a_config(trailmark: Run, drive: Path, tmp_path: Path) -> None:
    done = trailmark("record", "wheels.csv", "--out", "set", "--json")

    assert json.loads(done.stdout) == {
        "status": "done",
        "folder": "set",
        "frames": {"wheels": 400},
        "playable": ["wheels"],
        "dropped": 0,
        "too_far": 0,
    }


def test_a_source_that_fails_leaves_what_came_before(trailmark: Run, drive: Path, tmp_path: Path) -> None:
    (tmp_path / "pictures" / "3.png").write_bytes(b"no picture")

    done = trailmark("record", drive, "--out", "set")

    assert done.returncode == 2
    assert "3.png" in done.stderr
    assert "Traceback" not in done.stderr
    assert [name for name, _, _ in frames_of(tmp_path / "set" / "config.yaml")].count("front") == 3


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("wheels.yaml",), ("--out",)),
        (("nowhere.yaml", "--out", "set"), ("nowhere.yaml",)),
        (("wheels.yaml", "--out", "full"), ("full is not empty", "--overwrite")),
        (("wheels.yaml", "--out", "pictures"), ("sources.front.path is read from there",)),
        (("empty.yaml", "--out", "set"), ("empty.yaml", "no sources to record")),
    ],
)
def test_a_wrong_request_is_one_line(
    trailmark: Run, drive: Path, tmp_path: Path, arguments: tuple[str, ...], words: tuple[str, ...]
) -> None:
    (tmp_path / "empty.yaml").write_text("seed: 1\n")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").touch()

    done = trailmark("record", *arguments)

    assert done.returncode == 2
    assert all(word in done.stderr for word in words)
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "set").exists()


def test_what_is_read_is_not_written_over(trailmark: Run, drive: Path, tmp_path: Path) -> None:
    assert trailmark("record", drive, "--out", "kept").returncode == 0
    before = {path: path.read_bytes() for path in (tmp_path / "kept").rglob("*") if path.is_file()}

    for target in ("kept/config.yaml", "kept/wheels.csv"):
        refused = trailmark("record", target, "--out", "kept", "--overwrite")
        assert refused.returncode == 2
        assert "is read from there; choose another folder" in refused.stderr

    assert {path: path.read_bytes() for path in (tmp_path / "kept").rglob("*") if path.is_file()} == before


def test_ctrl_c_keeps_a_recording_that_plays_again(drive: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "trailmark.cli", "record", str(drive), "--out", "set", "--set", "pace=realtime"]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    wait_for(tmp_path / "set" / "front" / "000000.png")
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=30)

    assert process.returncode == 130
    assert "what came before is kept" in told
    played = frames_of(tmp_path / "set" / "config.yaml")
    assert 0 < len(played) < 405
    assert played == frames_of(drive)[: len(played)]


def wait_for(path: Path) -> None:
    """Return when the file is there."""
    waiting = threading.Event()
    for _ in range(1200):
        if path.exists():
            return
        waiting.wait(0.05)
    pytest.fail(f"{path.name} did not come: {os.listdir(path.parents[1])}")
