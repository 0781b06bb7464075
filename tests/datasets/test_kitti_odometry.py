"""Sequences of the KITTI odometry benchmark."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.errors import SourceError
from trailmark.frames import Pinhole
from trailmark.interfaces import Session
from trailmark_datasets.config import KittiOdometryConfig
from trailmark_datasets.kitti_odometry import KittiOdometry


@pytest.fixture
def sequence(tmp_path, write_picture):
    """Four pictures of a car that drives 1 m ahead per frame and turns right by 2 degrees."""
    path = tmp_path / "sequences" / "00"
    rows = []
    for i in range(4):
        write_picture(path / f"image_0/{i:06d}.png", i)
        write_picture(path / f"image_2/{i:06d}.png", 10 + i, colour=True)
        turn = math.radians(2 * i)  # about the camera's y axis, which points down: to the right
        matrix = [[math.cos(turn), 0, math.sin(turn), 0.1 * i], [0, 1, 0, 0], [-math.sin(turn), 0, math.cos(turn), i]]
        rows.append(" ".join(f"{value:e}" for row in matrix for value in row))
    (path / "times.txt").write_text("".join(f"{0.1 * i:e}\n" for i in range(4)))
    (path / "calib.txt").write_text(
        "".join(f"P{i}: 718.9 0 607.2 {-100 * i} 0 719.1 185.2 0 0 0 1 0\n" for i in range(4))
    )
    (tmp_path / "poses").mkdir()
    (tmp_path / "poses" / "00.txt").write_text("\n".join(rows))
    return path


def kitti(path, **keys) -> KittiOdometry:
    return KittiOdometry(KittiOdometryConfig.model_validate({"path": path, **keys}))


def values(frames) -> list[int]:
    return [int(frame.payload.pixels.flat[0]) for frame in frames]


def test_pictures_times_calibration_and_truth_are_found(sequence, play):
    source = kitti(sequence)

    frames = play(source, "car")
    truth = source.ground_truth()

    assert values(frames) == [0, 1, 2, 3]
    np.testing.assert_allclose([frame.stamp_s for frame in frames], [0.0, 0.1, 0.2, 0.3])
    info = source.sensors["car"]
    assert info.size == (12, 8)
    assert info.calibration == Pinhole(718.9, 719.1, 607.2, 185.2)
    assert truth is not None
    expected = [[i, -0.1 * i, math.radians(-2 * i)] for i in range(4)]  # x right of the camera is -y
    np.testing.assert_allclose(truth.poses, expected, atol=1e-6)


def test_a_cut_sequence_has_the_truth_from_where_it_begins(sequence, play):
    source = kitti(sequence, start_s=0.1)
    play(source)

    truth = source.ground_truth()

    assert truth is not None
    np.testing.assert_allclose(truth.poses[1], 0.0, atol=1e-9)  # the first that is delivered
    assert truth.poses[0, 0] < 0.0  # the one before lies behind


def test_another_camera_is_chosen_by_name(sequence, play):
    frames = play(kitti(sequence, camera="image_2"))

    assert values(frames) == [10, 11, 12, 13]
    assert frames[0].payload.pixels.ndim == 3


def test_a_part_of_a_sequence_keeps_its_times_and_poses(sequence, play):
    (sequence / "image_0/000000.png").unlink()
    source = kitti(sequence)

    frames = play(source)
    truth = source.ground_truth()

    assert frames[0].stamp_s == pytest.approx(0.1)
    assert truth is not None
    np.testing.assert_allclose(truth.stamps_s, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(truth.poses[0], 0, atol=1e-9)


def test_a_plain_folder_plays_at_the_rate(sequence, play):
    source = kitti(sequence / "image_0", rate_hz=5)

    np.testing.assert_allclose([frame.stamp_s for frame in play(source)], [0.0, 0.2, 0.4, 0.6])
    assert source.sensors["front"].calibration is None
    assert source.ground_truth() is None


def test_a_number_left_out_inside_is_a_missing_picture(sequence, play):
    (sequence / "image_0/000002.png").unlink()

    with pytest.raises(SourceError, match=r"times\.txt:3 \(.*000002\.png\): cannot be read: No such file"):
        play(kitti(sequence))

    source = kitti(sequence, on_bad_frame="skip")
    assert values(play(source)) == [0, 1, 3]
    assert source.counters() == {"skipped": 1}


def test_times_that_go_back_have_neither_frame_nor_truth(sequence, play):
    (sequence / "times.txt").write_text("0\n0.2\n0.1\n0.3\n")
    source = kitti(sequence, on_bad_frame="skip")

    assert values(play(source)) == [0, 1, 3]
    truth = source.ground_truth()
    assert truth is not None
    np.testing.assert_allclose(truth.stamps_s, [0.0, 0.2, 0.3])


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("times.txt", "0\n0.1\n", r"times\.txt has 2 stamps, but there is a picture number 3"),
        ("calib.txt", "P1: 1 0 0 0 0 1 0 0 0 0 1 0\n", r"calib\.txt: no line P0: for image_0"),
        ("calib.txt", "P0: 1 0 0\n", r"calib\.txt:1: expected the 12 numbers of a 3x4 matrix, found 3"),
        ("calib.txt", "P0: 0 0 0 0 0 1 0 0 0 0 1 0\n", r"calib\.txt:1: focal lengths must be positive"),
    ],
)
def test_files_that_do_not_fit_are_refused(sequence, name, text, message):
    (sequence / name).write_text(text)

    with pytest.raises(SourceError, match=message):
        kitti(sequence).start(Session())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 0 0 0 0 1 0 0 0 0 1 0\n" * 3 + "0 0 0 0 0 1 0 0 0 0 1 0\n", r"00\.txt:4: .* no rotation"),
        ("1 0 0 0 0 1 0 0 0 0 1e300 0\n" * 4, r"00\.txt:1: .* no rotation"),
        ("1 0 0 0 0 1 0 0 0 0 1 0\n", r"00\.txt has 1 poses, but there is a picture number 3"),
        ("1 0 0 0 0 1 0 0 0 0 1 x\n", r"00\.txt:1: a number of the matrix is 'x'"),
    ],
)
def test_poses_that_do_not_fit_are_refused(sequence, text, message):
    (sequence.parents[1] / "poses" / "00.txt").write_text(text)
    source = kitti(sequence)
    source.start(Session())

    with pytest.raises(SourceError, match=message):
        source.ground_truth()


def test_names_that_are_no_numbers_are_refused(tmp_path, write_picture):
    write_picture(tmp_path / "left.png")

    with pytest.raises(SourceError, match=r"left\.png: pictures of KITTI are named by number.*'image_folder'"):
        kitti(tmp_path).start(Session())


def test_names_that_are_stamps_are_no_indices(tmp_path, write_picture):
    for name in ("1403636579763555584", "1403636579813555456"):
        write_picture(tmp_path / f"{name}.png")

    with pytest.raises(SourceError, match=r"2 pictures between number 1403636579763555584 and .* are no indices"):
        kitti(tmp_path).start(Session())


@pytest.mark.parametrize(
    ("gone", "words"),
    [
        (["image_0/000000.png"], "pictures are numbers 1 to 3: 1 at the beginning and 0 at the end are missing"),
        (["image_0/000002.png", "image_0/000003.png"], "numbers 0 to 1: 0 at the beginning and 2 at the end"),
    ],
)
def test_pictures_missing_at_the_ends_are_said(sequence, play, caplog, gone, words):
    for name in gone:
        (sequence / name).unlink()

    play(kitti(sequence))

    assert words in caplog.text


@pytest.mark.parametrize(
    ("gone", "words"),
    [
        ("image_0/000000.png", "has no times.txt, and the pictures are numbers 1 to 3: 1 at the beginning"),
        ("image_0/000003.png", "has 4 poses, and the pictures are numbers 0 to 2: 0 at the beginning and 1 at the end"),
    ],
)
def test_pictures_missing_at_the_ends_are_said_without_stamps_too(sequence, play, caplog, gone, words):
    (sequence / "times.txt").unlink()
    (sequence / gone).unlink()
    source = kitti(sequence)

    play(source)
    source.ground_truth()

    assert words in caplog.text


def test_a_whole_sequence_is_not_remarked_on(sequence, play, caplog):
    play(kitti(sequence))

    assert not caplog.records
