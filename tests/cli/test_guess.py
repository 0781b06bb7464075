"""Recordings that are named without a config."""

from __future__ import annotations

from pathlib import Path

import pytest

from trailmark.cli.guess import guess_config, is_config
from trailmark.errors import ConfigError
from trailmark.plugins import Registry, load_plugins


@pytest.fixture(scope="module")
def registry() -> Registry:
    return load_plugins().registry


@pytest.mark.parametrize(
    ("files", "target", "plugin"),
    [
        (["cart.mp4"], "cart.mp4", "video"),
        (["frames/000.png"], "frames", "image_folder"),
        (["desk/rgb.txt", "desk/depth.txt"], "desk", "tum_rgbd"),
        (["chess/frame-000000.color.png", "chess/frame-000000.pose.txt"], "chess", "rgbd_folder"),
        (["scene/color/0.jpg", "scene/intrinsic/intrinsic_color.txt"], "scene", "rgbd_folder"),
        (["00/times.txt", "00/image_0/000000.png"], "00", "kitti_odometry"),
        (["wheels.csv"], "wheels.csv", "csv_odometry"),
        (["intel.log.gz"], "intel.log.gz", "carmen_log"),
        (["run.bag"], "run.bag", "rosbag"),
        (["ros2/metadata.yaml"], "ros2", "rosbag"),
    ],
)
def test_the_source_is_guessed(tmp_path: Path, registry: Registry, files: list[str], target: str, plugin: str) -> None:
    for file in files:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).touch()

    (source,) = guess_config(str(tmp_path / target), registry)["sources"].values()

    assert source["plugin"] == plugin
    assert source["path"] == str(tmp_path / target)


def test_a_camera_has_a_number(registry: Registry) -> None:
    assert guess_config("camera:1", registry)["sources"]["camera"] == {"plugin": "camera", "device": 1}


def test_a_name_that_is_no_sensor_name_is_replaced(tmp_path: Path, registry: Registry) -> None:
    (tmp_path / "2024-01-01 drive.mp4").touch()

    assert list(guess_config(str(tmp_path / "2024-01-01 drive.mp4"), registry)["sources"]) == ["video"]


def test_a_missing_file_is_an_error_with_the_nearest_name(tmp_path: Path, registry: Registry) -> None:
    (tmp_path / "cart.mp4").touch()

    with pytest.raises(ConfigError, match=r"did you mean .*cart\.mp4\?"):
        guess_config(str(tmp_path / "crat.mp4"), registry)


def test_a_file_that_nothing_opens_is_an_error_that_says_what_opens(tmp_path: Path, registry: Registry) -> None:
    (tmp_path / "notes.docx").touch()

    with pytest.raises(ConfigError, match=r"no source opens .*notes\.docx; they open .*\*\.bag"):
        guess_config(str(tmp_path / "notes.docx"), registry)


@pytest.mark.parametrize(
    ("name", "expected"), [("a.yaml", True), ("a.TOML", True), ("a.mp4", False), ("folder", False)]
)
def test_configs_are_known_by_their_suffix(name: str, expected: bool) -> None:
    assert is_config(name) is expected
