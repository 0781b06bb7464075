"""What the plugin brings: registered parts, light imports, a starter that loads."""

from __future__ import annotations

import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import pytest

from trailmark.config import load_run_config
from trailmark.plugins import load_plugins


@pytest.mark.parametrize(
    ("name", "gives"), [("kinect_landmarks", "fix"), ("kinect_motion", "motion"), ("kinect_flow", "motion")]
)
def test_the_localizers_are_registered_and_load(name: str, gives: str) -> None:
    spec = load_plugins().registry.find("localizer", name)

    assert spec.gives == {gives}
    assert spec.load()(spec.load_config()(camera="kinect")) is not None


def test_plugin_and_config_import_nothing_heavy() -> None:
    code = (
        "import sys, trailmark_kinect_landmarks.plugin, trailmark_kinect_landmarks.config;"
        "print(sorted({'cv2', 'numba', 'scipy', 'sklearn', 'matplotlib'} & set(sys.modules)))"
    )

    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_the_starter_describes_itself_and_loads(tmp_path: Path) -> None:
    text = files("trailmark_kinect_landmarks").joinpath("starters/rgbd.yaml").read_text(encoding="utf-8")
    (tmp_path / "rgbd_dataset").mkdir()
    config = tmp_path / "rgbd.yaml"
    config.write_text(text, encoding="utf-8")

    run = load_run_config(config, plugins=load_plugins())

    assert text.startswith("# ")
    assert run.localizers["landmarks"].spec.name == "kinect_landmarks"


def test_the_comments_of_the_starter_are_true(tmp_path: Path) -> None:
    text = files("trailmark_kinect_landmarks").joinpath("starters/rgbd.yaml").read_text(encoding="utf-8")
    (tmp_path / "rgbd_dataset").mkdir()
    lines = ("# calibration:", "#   colour:", "#   depth:", "#   pose_colour_depth:", "# finders:", "# debug_images:")
    for line in lines:
        text = text.replace(line, "  ".join(["", line[1:].lstrip()]) if line.startswith("#   ") else line[2:])
    config = tmp_path / "rgbd.yaml"
    config.write_text(text, encoding="utf-8")

    run = load_run_config(config, plugins=load_plugins())

    assert run.sources["kinect"].calibration.depth.fx == 585.0  # type: ignore[union-attr]
    assert run.localizers["landmarks"].config.finders == ("blobs", "rectangles")  # type: ignore[attr-defined]
