"""What the cameras saw, on the page of a run."""

from __future__ import annotations

import re
from base64 import b64decode
from pathlib import Path

import cv2
import numpy as np
import pytest

import trailmark
from trailmark.errors import DataError
from trailmark.frames import RGBD, Frame, Image, Odometry
from trailmark.geometry import Pose2
from trailmark.report.glimpses import FOLDER, Glimpses, glimpses_section


def grey(level: int, width: int = 64) -> Image:
    return Image(np.full((48, width), level, np.uint8))


def times(folder: Path, sensor: str) -> list[float]:
    return sorted(float(path.stem.removeprefix(f"{sensor}_")[:-1]) for path in (folder / FOLDER).glob(f"{sensor}_*"))


@pytest.mark.parametrize("n_frames", [1, 2, 12, 13, 50, 1000])
def test_a_few_pictures_are_kept_spread_over_the_run(n_frames: int, tmp_path: Path) -> None:
    glimpses = Glimpses()
    for index in range(n_frames):
        glimpses.see(Frame("front", 100.0 + index, grey(index % 256)))
    glimpses.write(tmp_path)

    kept = times(tmp_path, "front")
    assert kept[0] == 0.0
    assert min(n_frames, 6) <= len(kept) <= 12
    steps = np.diff(kept)
    assert len(set(steps.tolist())) <= 1  # even
    assert n_frames - 1 - kept[-1] <= (steps[0] if len(steps) else 0)


def test_the_page_shows_the_pictures_that_were_seen(tmp_path: Path) -> None:
    glimpses = Glimpses()
    glimpses.see(None)
    glimpses.see(Frame("wheels", 10.0, Odometry(Pose2())))
    glimpses.see(Frame("front", 10.5, grey(200, width=640)))
    glimpses.see(Frame("deep", 10.5, Image(np.full((48, 64), 100 << 8, np.uint16))))
    glimpses.see(Frame("kinect", 11.0, RGBD(np.full((48, 64, 3), 50, np.uint8), np.ones((48, 64), np.float32))))
    glimpses.write(tmp_path)

    page = glimpses_section(tmp_path)

    shown = re.findall(r'base64,([^"]+)" alt="(\w+), ([\d.]+) s"', page)
    assert [(name, time) for _, name, time in shown] == [("deep", "0.5"), ("front", "0.5"), ("kinect", "1.0")]
    pictures = {name: cv2.imdecode(np.frombuffer(b64decode(data), np.uint8), 0) for data, name, _ in shown}
    assert pictures["front"].shape == (24, 320)
    assert {name: round(float(picture.mean())) for name, picture in pictures.items()} == {
        "deep": 100,
        "front": 200,
        "kinect": 50,
    }


def test_files_of_strangers_do_not_get_into_the_page(tmp_path: Path) -> None:
    folder = tmp_path / FOLDER
    folder.mkdir()
    (tmp_path / "secret").write_bytes(b"secret")
    (folder / "front_1.00s.jpg").symlink_to(tmp_path / "secret")
    (folder / "<b>_1.00s.jpg").write_bytes(b"x")
    (folder / "rear_1.00s.jpg").write_bytes(b"x" * 300_000)

    assert glimpses_section(tmp_path) == ""
    assert glimpses_section(tmp_path / "none") == ""


def test_pictures_that_cannot_be_written_are_told(tmp_path: Path) -> None:
    (tmp_path / FOLDER).write_text("in the way")
    glimpses = Glimpses()
    glimpses.see(Frame("front", 0.0, grey(1)))

    with pytest.raises(DataError, match="cannot write pictures into"):
        glimpses.write(tmp_path)


def test_a_run_leaves_pictures_only_with_a_report(tmp_path: Path) -> None:
    source = {"plugin": "sim", "world": "ground_course", "sensors": ["floor", "wheels"], "duration_s": 0.2}
    config = {"sources": {"robot": source}, "localizers": {"wheels": "odometry"}}

    trailmark.run(config, tmp_path / "with")
    trailmark.run(config, tmp_path / "without", report=False)
    trailmark.run(config, tmp_path / "with", report=False, overwrite=True)

    assert not (tmp_path / "without" / FOLDER).exists()
    assert not (tmp_path / "with" / FOLDER).exists()  # those of the earlier run are gone
