"""Numbered files of colour, depth and poses: 7-Scenes, exports of ScanNet."""

from __future__ import annotations

import logging
import math
from pathlib import Path

import numpy as np
import pytest

from trailmark.errors import SourceError
from trailmark.frames import DepthCamera
from trailmark.interfaces import Session
from trailmark_datasets.config import RgbdFolderConfig
from trailmark_datasets.rgbd_folder import RgbdFolder


def pose_text(way_m: float, turn_rad: float = 0.0) -> str:
    """Return the matrix of a camera that has gone so far along its optical axis, and turned left."""
    cos, sin = math.cos(turn_rad), math.sin(turn_rad)
    rows = ((cos, 0, -sin, 0), (0, 1, 0, 0), (sin, 0, cos, way_m), (0, 0, 0, 1))
    return "\n".join("\t".join(f"{value:.7e}" for value in row) for row in rows) + "\n"


@pytest.fixture
def scenes(tmp_path: Path, write_picture) -> Path:
    """Frames 0, 1 and 3 in the layout of 7-Scenes; the camera drives 0.1 m a picture and turns left by 2 degrees."""
    for n in (0, 1, 3):
        write_picture(tmp_path / f"frame-{n:06d}.color.png", 10 * n, colour=True)
        write_picture(tmp_path / f"frame-{n:06d}.depth.png", 1000 * (n + 1), dtype=np.uint16)
        (tmp_path / f"frame-{n:06d}.pose.txt").write_text(pose_text(0.1 * n, math.radians(2.0 * n)))
    return tmp_path


@pytest.fixture
def scannet(tmp_path: Path, write_picture) -> Path:
    """Frames 0, 9 and 10 in the layout of ScanNet, whose depth pictures are half as large."""
    for n in (0, 9, 10):
        write_picture(tmp_path / f"color/{n}.jpg", n, size=(24, 16), colour=True)
        write_picture(tmp_path / f"depth/{n}.png", 2000, dtype=np.uint16)
        (tmp_path / "pose").mkdir(exist_ok=True)
        (tmp_path / f"pose/{n}.txt").write_text(pose_text(0.01 * n))
    (tmp_path / "intrinsic").mkdir()
    (tmp_path / "intrinsic/intrinsic_color.txt").write_text("20 0 11.5 0\n0 21 7.5 0\n0 0 1 0\n0 0 0 1\n")
    return tmp_path


def rgbd(path: Path, **keys) -> RgbdFolder:
    return RgbdFolder(RgbdFolderConfig.model_validate({"path": path, **keys}))


def test_what_has_one_number_is_one_frame_and_a_missing_number_takes_its_time(scenes, play):
    source = rgbd(scenes, rate_hz=10)

    frames = play(source, "kinect")

    assert [frame.stamp_s for frame in frames] == [0.0, 0.1, 0.3]
    assert [int(frame.payload.bgr[0, 0, 0]) for frame in frames] == [0, 10, 30]
    assert [float(frame.payload.depth_m[0, 0]) for frame in frames] == [1.0, 2.0, 4.0]
    assert source.sensors["kinect"].kind == "rgbd"
    assert source.sensors["kinect"].calibration is None
    assert source.lasts_s() == pytest.approx(0.3)


def test_numbers_are_ordered_as_numbers_and_the_lens_of_the_smaller_depth_is_scaled(scannet, play):
    source = rgbd(scannet)

    frames = play(source)

    assert [round(frame.stamp_s * 30) for frame in frames] == [0, 9, 10]
    calibration = source.sensors["front"].calibration
    assert isinstance(calibration, DepthCamera)
    assert (calibration.colour.fx, calibration.colour.fy, calibration.colour.cx) == (20.0, 21.0, 11.5)
    assert calibration.depth is not None
    assert (calibration.depth.fx, calibration.depth.fy) == (10.0, 10.5)
    assert (calibration.depth.cx, calibration.depth.cy) == (5.5, 3.5)  # the middle of 12 x 8 pixels


def test_the_lens_of_depth_is_read_where_it_is_told(scannet, play):
    (scannet / "intrinsic/intrinsic_depth.txt").write_text("9 0 5 0\n0 9 3 0\n0 0 1 0\n0 0 0 1\n")
    source = rgbd(scannet)
    play(source)

    assert source.sensors["front"].calibration.depth.fx == 9.0


@pytest.mark.parametrize("place", [".", ".."])
@pytest.mark.parametrize(
    ("name", "text"), [("camera.txt", "500 501 6 4\n2000\n"), ("intrinsics.txt", "500 0 6\n0 501 4\n0 0 1\n")]
)
def test_the_lens_stands_in_the_folder_or_above(tmp_path, scenes, play, write_picture, place, name, text):
    sequence = tmp_path / "below"
    sequence.mkdir()
    for file in scenes.glob("frame*"):
        file.rename(sequence / file.name)
    (sequence / place / name).write_text(text)
    source = rgbd(sequence)

    frames = play(source)

    calibration = source.sensors["front"].calibration
    assert (calibration.colour.fx, calibration.colour.fy, calibration.colour.cy) == (500.0, 501.0, 4.0)
    assert calibration.depth is None  # pixel by pixel that of colour
    assert float(frames[0].payload.depth_m[0, 0]) == (0.5 if name == "camera.txt" else 1.0)


def test_depth_of_the_largest_value_is_unknown(scenes, play, write_picture):
    write_picture(scenes / "frame-000001.depth.png", 65535, dtype=np.uint16)

    frames = play(rgbd(scenes))

    assert np.isnan(frames[1].payload.depth_m).all()


def test_the_truth_is_seen_from_the_first_frame(scenes, play):
    source = rgbd(scenes, rate_hz=10)
    play(source)

    truth = source.ground_truth()

    assert truth is not None
    np.testing.assert_allclose(truth.stamps_s, [0.0, 0.1, 0.3])
    expected = [[0, 0, 0], [0.1, 0, math.radians(2)], [0.3, 0, math.radians(6)]]
    np.testing.assert_allclose(truth.poses, expected, atol=1e-6)


@pytest.mark.parametrize("text", ["-inf " * 16, "nan " * 16, None])
def test_where_the_camera_was_lost_there_is_no_truth(scenes, play, caplog, text):
    file = scenes / "frame-000001.pose.txt"
    file.unlink() if text is None else file.write_text(text)
    source = rgbd(scenes, rate_hz=10)
    play(source)

    with caplog.at_level(logging.WARNING):
        truth = source.ground_truth()

    assert truth is not None
    np.testing.assert_allclose(truth.stamps_s, [0.0, 0.3])
    assert "1 of 3 frames have no true pose" in caplog.text


def test_where_the_camera_was_always_lost_that_is_said(scenes, play, caplog):
    for file in scenes.glob("*.pose.txt"):
        file.write_text("nan " * 16)
    source = rgbd(scenes)
    play(source)

    with caplog.at_level(logging.WARNING):
        assert source.ground_truth() is None

    assert "3 of 3 frames have no true pose" in caplog.text


def test_a_pattern_of_poses_that_matches_nothing_is_refused(scenes):
    with pytest.raises(SourceError, match=r"nothing matches \*\.poses\.txt; set poses"):
        rgbd(scenes, poses="*.poses.txt").start(Session())


def test_three_rows_of_a_pose_are_enough(scenes, play):
    for file in scenes.glob("*.pose.txt"):
        file.write_text("\n".join(file.read_text().splitlines()[:3]))
    source = rgbd(scenes, rate_hz=10)
    play(source)

    np.testing.assert_allclose(source.ground_truth().poses[-1], [0.3, 0.0, math.radians(6)], atol=1e-6)


def test_a_bad_pose_takes_away_its_own_truth_alone_where_bad_frames_are_skipped(scenes, play):
    (scenes / "frame-000001.pose.txt").write_text("banana " * 12)
    source = rgbd(scenes, rate_hz=10, on_bad_frame="skip")
    play(source)

    np.testing.assert_allclose(source.ground_truth().stamps_s, [0.0, 0.3])


@pytest.mark.parametrize("pattern", [".", "./"])
def test_a_pattern_that_is_none_is_refused_in_one_line(scenes, pattern):
    with pytest.raises(SourceError, match=r"cannot list pattern|nothing matches"):
        rgbd(scenes, colour=pattern).start(Session())


@pytest.mark.parametrize(
    "text",
    [
        "585 0 320\n0 585 240\n0 0 1\n",  # of pictures of 640 x 480
        "20 0 0\n0 20 0\n6 4 1\n",  # column by column
        "20 20 6 4 0.1 0.2 0 0 0.3\n",  # lens and distortion
    ],
)
def test_a_lens_that_cannot_be_that_of_the_pictures_is_refused(scenes, text):
    (scenes / "intrinsics.txt").write_text(text)

    with pytest.raises(SourceError, match=r"outside of the colour picture of 12 x 8|column by column"):
        rgbd(scenes).start(Session())


def test_without_files_of_poses_there_is_no_truth(scenes, play):
    for file in scenes.glob("*.pose.txt"):
        file.unlink()
    source = rgbd(scenes)
    play(source)

    assert source.ground_truth() is None


def test_what_has_no_partner_is_counted(scenes, play):
    (scenes / "frame-000001.depth.png").unlink()
    source = rgbd(scenes)

    assert len(play(source)) == 2
    assert source.counters()["unpaired_colour"] == 1


def test_patterns_replace_the_known_layouts(tmp_path, play, write_picture):
    write_picture(tmp_path / "left/a7.png", 3, colour=True)
    write_picture(tmp_path / "range/a7.png", 500, dtype=np.uint16)

    frames = play(rgbd(tmp_path, colour="left/*", depth="range/*", depth_factor=500))

    assert float(frames[0].payload.depth_m[0, 0]) == 1.0


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (
            lambda folder: [file.unlink() for file in folder.glob("*.depth.png")],
            r"nothing matches \*\.depth\.\* or depth/\*; set depth: a pattern",
        ),
        (lambda folder: (folder / "frame-000001.color.png").rename(folder / "frame.color.png"), "has no number before"),
        (
            lambda folder: (folder / "frame-000001.color.png").rename(folder / "other-000003.color.png"),
            "have the same number",
        ),
        (lambda folder: (folder / "camera.txt").write_text("585 585 320\n"), "expected fx fy cx cy"),
        (lambda folder: (folder / "intrinsics.txt").write_text("585 0 320\n"), "expected the 9 or 16 numbers"),
        (
            lambda folder: [file.rename(f"{file}".replace("-000003", "-9000003")) for file in folder.glob("*03.*")],
            "between the numbers 0 and 9000003: these are no indices",
        ),
        (lambda folder: (folder / "camera.txt").write_text("0 585 320 240\n"), "focal lengths must be positive"),
    ],
)
def test_what_is_missing_or_ambiguous_is_named(scenes, spoil, message):
    spoil(scenes)

    with pytest.raises(SourceError, match=message):
        rgbd(scenes).start(Session())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2 3\n", "expected the 12 or 16 numbers"),
        ("0 " * 12, "are no rotation"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0", "are no rotation"),  # a mirror
        ("x " * 12, "not a number"),
        ("1 0 0 0 0 1 0 0 0 0 1 0 0.5 0 0 1", "is the matrix written column by column"),
    ],
)
def test_a_malformed_pose_is_named(scenes, play, text, message):
    (scenes / "frame-000001.pose.txt").write_text(text)
    source = rgbd(scenes)
    play(source)

    with pytest.raises(SourceError, match=message):
        source.ground_truth()


def test_numbers_of_colour_and_depth_that_never_meet_are_told(tmp_path, write_picture):
    write_picture(tmp_path / "rgb/1.png", 3, colour=True)
    write_picture(tmp_path / "depth/2.png", 500, dtype=np.uint16)

    with pytest.raises(SourceError, match=r"1\.png and 2\.png are the first; set the patterns"):
        rgbd(tmp_path).start(Session())
