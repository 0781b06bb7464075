"""Sequences of the TUM RGB-D benchmark."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from trailmark.errors import SourceError
from trailmark.frames import DepthCamera
from trailmark.interfaces import Session
from trailmark_datasets.config import TumRgbdConfig
from trailmark_datasets.tum_rgbd import TumRgbd


@pytest.fixture
def sequence(tmp_path, write_picture):
    """Three frames, the depth 5 ms late, and a robot that drives straight on at 1 m/s, 10 degrees a second left."""
    write = write_picture
    colour, depth, truth = ["# color images"], ["# depth maps"], ["# timestamp tx ty tz qx qy qz qw"]
    for i in range(3):
        stamp_s = 10.0 + 0.1 * i
        write(tmp_path / f"rgb/{i}.png", 10 * i, colour=True)
        write(tmp_path / f"depth/{i}.png", 5000 * (i + 1), dtype=np.uint16)
        colour.append(f"{stamp_s:.6f} rgb/{i}.png")
        depth.append(f"{stamp_s + 0.005:.6f} depth/{i}.png")
    for i in range(50):
        stamp_s = 9.995 + 0.01 * i
        turn = -math.radians(10) * (stamp_s - 10.0)  # about the optical y axis, which points down: left is negative
        truth.append(f"{stamp_s:.4f} 0 0 {stamp_s - 10.0:.6f} 0 {math.sin(turn / 2):.9f} 0 {math.cos(turn / 2):.9f}")
    (tmp_path / "rgb.txt").write_text("\n".join(colour))
    (tmp_path / "depth.txt").write_text("\n".join(depth))
    (tmp_path / "groundtruth.txt").write_text("\n".join(truth))
    return tmp_path


def tum(path, **keys) -> TumRgbd:
    return TumRgbd(TumRgbdConfig.model_validate({"path": path, **keys}))


def test_colour_and_depth_are_paired_at_the_colour_stamp(sequence, play):
    source = tum(sequence)

    frames = play(source, "kinect")

    assert [frame.stamp_s for frame in frames] == [10.0, 10.1, 10.2]
    assert [int(frame.payload.bgr[0, 0, 0]) for frame in frames] == [0, 10, 20]
    assert [float(frame.payload.depth_m[0, 0]) for frame in frames] == [1.0, 2.0, 3.0]
    info = source.sensors["kinect"]
    assert (info.kind, info.size, info.calibration) == ("rgbd", (12, 8), None)
    assert info.rate_hz == pytest.approx(10.0)
    assert source.lasts_s() == pytest.approx(0.2)
    assert source.counters() == {"unpaired_colour": 0, "unpaired_depth": 0}


def test_the_camera_file_gives_lens_and_depth_factor(sequence, play):
    (sequence / "camera.txt").write_text("# fx fy cx cy d0 ..\n500 501 6 4 0.1 0.2 0 0 0.3\n# factor\n2500\n")
    source = tum(sequence)

    frames = play(source)

    calibration = source.sensors["front"].calibration
    assert isinstance(calibration, DepthCamera)
    assert calibration.depth is None
    assert (calibration.colour.fx, calibration.colour.cy) == (500, 4)
    assert calibration.colour.distortion == (0.1, 0.2, 0, 0, 0.3)
    assert float(frames[0].payload.depth_m[0, 0]) == 2.0
    assert float(play(tum(sequence, depth_factor=1000))[0].payload.depth_m[0, 0]) == 5.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("500 501 6\n", r"camera\.txt: expected fx fy cx cy"),
        ("500 501 6 x\n", r"camera\.txt:1: a lens parameter is 'x', not a number"),
        ("500 501 6 4 1\n", r"camera\.txt:1: distortion has 4, 5 or 8 numbers"),
        ("500 501 6 4\n0\n", r"camera\.txt:2: the depth factor must be positive"),
    ],
)
def test_a_malformed_camera_file_is_refused(sequence, text, message):
    (sequence / "camera.txt").write_text(text)

    with pytest.raises(SourceError, match=message):
        tum(sequence).start(Session())


def test_the_truth_is_interpolated_to_the_frames_and_seen_from_the_first(sequence, play):
    source = tum(sequence)
    play(source)

    truth = source.ground_truth()

    assert truth is not None
    np.testing.assert_allclose(truth.stamps_s, [10.0, 10.1, 10.2])
    expected = [[0, 0, 0], [0.1, 0, math.radians(1)], [0.2, 0, math.radians(2)]]
    np.testing.assert_allclose(truth.poses, expected, atol=2e-6)


def test_the_truth_is_that_of_base_when_the_camera_is_mounted(sequence, play):
    """A camera 1 m to the left of base: while it drives straight and turns left, base is a lever behind."""
    source = tum(sequence, mounting={"y": 1.0})
    play(source)

    truth = source.ground_truth()

    assert truth is not None
    turn = math.radians(2)
    expected = [0.2 + math.sin(turn), 1.0 - math.cos(turn), turn]
    np.testing.assert_allclose(truth.poses[2], expected, atol=2e-6)


def test_frames_that_the_truth_does_not_cover_have_none(sequence, play):
    lines = (sequence / "groundtruth.txt").read_text().splitlines()
    (sequence / "groundtruth.txt").write_text("\n".join(lines[:5] + lines[18:]))  # from 10.03 to 10.16 s: a gap
    source = tum(sequence)
    play(source)

    truth = source.ground_truth()

    assert truth is not None
    np.testing.assert_allclose(truth.stamps_s, [10.0, 10.2])
    assert len(tum_truth(sequence, max_truth_gap_s=1.0)) == 3


def tum_truth(path, **keys):
    source = tum(path, **keys)
    source.start(Session())
    truth = source.ground_truth()
    assert truth is not None
    return truth


def test_a_cut_recording_has_the_truth_of_one_that_begins_there(sequence):
    turns = [(0.1 * k, 0.2 * k, -0.3 * k) for k in range(50)]  # the camera tilts: planes differ
    lines = (sequence / "groundtruth.txt").read_text().splitlines()
    tilted = [
        " ".join([*line.split()[:4], *(f"{value:.9f}" for value in Rotation.from_euler("xyz", turn).as_quat())])
        for line, turn in zip(lines[1:], turns, strict=True)
    ]
    (sequence / "groundtruth.txt").write_text("\n".join([lines[0], *tilted]))

    cut = tum_truth(sequence, start_s=0.1)
    for name in ("rgb.txt", "depth.txt"):
        rows = (sequence / name).read_text().splitlines()
        (sequence / name).write_text("\n".join([rows[0], *rows[2:]]))
    whole = tum_truth(sequence)

    kept = cut.stamps_s >= 10.1 - 1e-9
    np.testing.assert_allclose(cut.poses[kept], whole.poses, atol=1e-9)
    np.testing.assert_allclose(cut.poses[kept][0], 0.0, atol=1e-12)


def test_truth_of_exactly_the_frames_stamps_needs_no_neighbour(sequence):
    exact = [f"{10.0 + 0.1 * i:.4f} {0.1 * i} 0 0 0 0 0 1" for i in range(3)]
    (sequence / "groundtruth.txt").write_text("\n".join(exact))

    truth = tum_truth(sequence, max_truth_gap_s=0.02)

    np.testing.assert_allclose(truth.stamps_s, [10.0, 10.1, 10.2])


def test_truth_that_is_too_thin_says_the_key_to_set(sequence, caplog):
    thin = [f"{9.93 + 0.15 * i:.4f} {0.1 * i} 0 0 0 0 0 1" for i in range(3)]
    (sequence / "groundtruth.txt").write_text("\n".join(thin))

    assert len(tum_truth(sequence)) == 0
    assert "covers 0 of 3 frames" in caplog.text
    assert "set max_truth_gap_s" in caplog.text


def test_a_truth_of_one_pose_covers_no_frame(sequence):
    (sequence / "groundtruth.txt").write_text("10.1 0 0 0 0 0 0 1\n")

    assert len(tum_truth(sequence)) == 0


def test_without_a_truth_file_there_is_none(sequence):
    (sequence / "groundtruth.txt").unlink()
    source = tum(sequence)
    source.start(Session())

    assert source.ground_truth() is None


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("11 0 0 0 0 0 1", "expected 8 numbers"),
        ("11 0 0 0 0 0 0 0", "qx qy qz qw is no unit quaternion"),
        ("11 0 0 zero 0 0 0 1", "a number of the pose is 'zero', not a number"),
        ("9 0 0 0 0 0 0 1", r"the stamp of a true pose goes back: 9\.0+ s after 10\.485"),
    ],
)
def test_a_malformed_truth_is_refused_with_its_line(sequence, line, message):
    with open(sequence / "groundtruth.txt", "a") as file:
        file.write(f"\n{line}\n")

    with pytest.raises(SourceError, match=rf"groundtruth\.txt:52: {message}"):
        tum_truth(sequence)


def test_pictures_without_a_partner_are_counted(sequence, play, write_picture):
    write_picture(sequence / "rgb/9.png", colour=True)
    with open(sequence / "rgb.txt", "a") as file:
        file.write("\n10.3 rgb/9.png\n")
    source = tum(sequence)

    assert len(play(source)) == 3
    assert source.counters()["unpaired_colour"] == 1


def test_lists_that_never_meet_are_refused(sequence):
    (sequence / "depth.txt").write_text("99.0 depth/0.png\n")

    with pytest.raises(SourceError, match=r"no colour picture has a depth picture within 0\.02 s; rgb.txt begins"):
        tum(sequence).start(Session())


def test_a_list_without_names_is_refused(sequence):
    (sequence / "rgb.txt").write_text("10.0\n10.1\n")

    with pytest.raises(SourceError, match=r"rgb\.txt:1 names no file beside the stamp"):
        tum(sequence).start(Session())


def test_a_folder_without_lists_is_refused(tmp_path):
    with pytest.raises(SourceError, match=r"cannot read .*rgb\.txt: No such file"):
        tum(tmp_path).start(Session())


@pytest.mark.parametrize("name", ["rgb/1.png", "depth/1.png"])
def test_a_missing_picture_is_an_error_or_a_counted_skip(sequence, play, name):
    (sequence / name).unlink()
    folder = name.split("/")[0]

    with pytest.raises(SourceError, match=rf"{folder}\.txt:3 \(.*{name}\): cannot be read: No such file"):
        play(tum(sequence))

    source = tum(sequence, on_bad_frame="skip")
    assert [frame.stamp_s for frame in play(source)] == [10.0, 10.2]
    assert source.counters()["skipped"] == 1


def test_a_missing_first_picture_is_skipped_too(sequence, play):
    (sequence / "rgb/0.png").unlink()

    assert len(play(tum(sequence, on_bad_frame="skip"))) == 2


def test_a_depth_that_changes_its_size_is_refused(sequence, play, write_picture):
    write_picture(sequence / "depth/2.png", 1, size=(6, 4), dtype=np.uint16)

    with pytest.raises(SourceError, match=r"rgb\.txt:4.*: a picture of 12x8 with depth 6x4 after .* with depth 12x8"):
        play(tum(sequence))


def test_a_stamp_that_goes_back_is_refused(sequence, play):
    lines = (sequence / "rgb.txt").read_text().splitlines()
    (sequence / "rgb.txt").write_text("\n".join([lines[0], lines[2], lines[1], lines[3]]))

    with pytest.raises(SourceError, match=r"rgb\.txt:3.*: the stamp goes back: 10\.0+ s after 10\.1"):
        play(tum(sequence))
