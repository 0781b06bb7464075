"""Pictures in a folder."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from trailmark.errors import SourceError
from trailmark.interfaces import Session
from trailmark_datasets.config import ImageFolderConfig
from trailmark_datasets.image_folder import ImageFolder
from trailmark_datasets.picture_source import missing_numbers


def folder(path, **keys) -> ImageFolder:
    return ImageFolder(ImageFolderConfig.model_validate({"path": path, **keys}))


def values(frames) -> list[int]:
    return [int(frame.payload.pixels.flat[0]) for frame in frames]


def test_pictures_come_in_natural_order_at_the_rate(tmp_path, write_picture, play):
    for name, value in (("f10.png", 3), ("f9.png", 2), ("f8.png", 1)):
        write_picture(tmp_path / name, value)
    (tmp_path / "notes.txt").write_text("no picture")
    source = folder(tmp_path, rate_hz=20)

    frames = play(source, "floor")

    assert values(frames) == [1, 2, 3]
    assert [frame.stamp_s for frame in frames] == [0.0, 0.05, 0.1]
    assert {frame.sensor for frame in frames} == {"floor"}
    info = source.sensors["floor"]
    assert (info.kind, info.size, info.rate_hz) == ("image", (12, 8), 20.0)
    assert source.ground_truth() is None
    assert source.lasts_s() == pytest.approx(0.1)


def test_a_pattern_chooses_among_the_files(tmp_path, write_picture, play):
    write_picture(tmp_path / "left" / "1.png", 1)
    write_picture(tmp_path / "right" / "1.png", 2)

    assert values(play(folder(tmp_path, rate_hz=1, pattern="right/*.png"))) == [2]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({}, r"no file is a picture \(\.bmp"),
        ({"pattern": "*.exr"}, r"no file matches pattern '\*\.exr'"),
        ({"pattern": "/etc/*"}, "cannot list pattern"),
    ],
)
def test_an_empty_folder_is_refused(tmp_path, keys, message):
    with pytest.raises(SourceError, match=message):
        folder(tmp_path, rate_hz=1, **keys).start(Session())


def test_a_file_is_no_folder(tmp_path, write_picture):
    path = write_picture(tmp_path / "a.png")

    with pytest.raises(SourceError, match=r"a\.png is no folder; for a film use the source 'video'"):
        folder(path, rate_hz=1).start(Session())


@pytest.mark.parametrize(("keys", "given"), [({}, "neither"), ({"rate_hz": 1, "timestamps": "t.txt"}, "both")])
def test_there_must_be_one_clock(tmp_path, keys, given):
    (tmp_path / "t.txt").write_text("0\n")
    keys = {key: str(tmp_path / value) if key == "timestamps" else value for key, value in keys.items()}

    with pytest.raises(ValidationError, match=f"only one of them; the config gives {given}"):
        folder(tmp_path, **keys)


def test_stamps_are_taken_in_order_of_the_pictures(tmp_path, write_picture, play):
    for i in range(3):
        write_picture(tmp_path / "frames" / f"{i}.png", i)
    (tmp_path / "times.txt").write_text("10\n20\n50\n")

    frames = play(folder(tmp_path / "frames", timestamps=tmp_path / "times.txt", time_unit="ms"))

    assert [frame.stamp_s for frame in frames] == [0.01, 0.02, 0.05]


def test_listed_pictures_come_as_the_list_says(tmp_path, write_picture, play):
    for i in range(3):
        write_picture(tmp_path / "rgb" / f"{i}.png", i)
    times = tmp_path / "rgb.txt"
    times.write_text("1.0 rgb/2.png\n2.0 rgb/0.png\n")

    frames = play(folder(tmp_path / "rgb", timestamps=times))

    assert values(frames) == [2, 0]
    assert [frame.stamp_s for frame in frames] == [1.0, 2.0]


def test_a_wrong_number_of_stamps_is_refused(tmp_path, write_picture):
    write_picture(tmp_path / "frames" / "0.png")
    (tmp_path / "times.txt").write_text("1\n2\n")

    with pytest.raises(SourceError, match=r"times\.txt has 2 stamps for 1 pictures in .*frames"):
        folder(tmp_path / "frames", timestamps=tmp_path / "times.txt").start(Session())


def test_a_listed_picture_that_is_missing_names_list_line_and_file(tmp_path, write_picture, play):
    write_picture(tmp_path / "0.png")
    (tmp_path / "times.txt").write_text("1 0.png\n2 1.png\n")

    with pytest.raises(SourceError, match=r"times\.txt:2 \(.*1\.png\): cannot be read: No such file"):
        play(folder(tmp_path, timestamps=tmp_path / "times.txt"))


def test_a_stamp_that_goes_back_names_its_line(tmp_path, write_picture, play):
    for i in range(3):
        write_picture(tmp_path / f"{i}.png")
    (tmp_path / "times.txt").write_text("1\n3\n2\n")

    with pytest.raises(SourceError, match=r"times\.txt:3 \(.*2\.png\): the stamp goes back: 2\.0+ s after 3\.0+ s"):
        play(folder(tmp_path, timestamps=tmp_path / "times.txt"))


def test_a_number_left_out_is_a_missing_picture(tmp_path, write_picture, play):
    for i in (5, 6, 7, 9):
        write_picture(tmp_path / f"f{i:04d}.png", i)

    with pytest.raises(SourceError, match=r"f0008\.png .*numbered: false.*cannot be read: No such file"):
        play(folder(tmp_path, rate_hz=10))

    source = folder(tmp_path, rate_hz=10, on_bad_frame="skip")
    frames = play(source)
    assert [round(frame.stamp_s, 9) for frame in frames] == [0.0, 0.1, 0.2, 0.4]  # time does not shrink
    assert source.counters() == {"skipped": 1}

    assert [frame.stamp_s for frame in play(folder(tmp_path, rate_hz=10, numbered=False))] == [0.0, 0.1, 0.2, 0.3]


@pytest.mark.parametrize(
    ("names", "missing"),
    [
        (["1.png", "2.png", "4.png", "5.png"], {2: "3.png"}),
        (["a000.jpg", "a010.jpg", "a020.jpg", "a040.jpg"], {3: "a030.jpg"}),
        (["1.png", "2.png", "3.png"], {}),
        (["1.png", "2.png", "4.png"], {}),  # no step is the usual one
        (["1.png", "3.png", "4.png", "9.png", "20.png"], {}),
        (["a1.png", "a2.png", "b4.png"], {}),
        (["1.png", "2.png", "3.png", "4.png", "999999999999.png"], {}),
        (["one.png"], {}),
        (["7.png"], {}),
    ],
)
def test_only_names_that_count_up_can_leave_one_out(names, missing):
    assert missing_numbers(names) == missing


def test_an_unreadable_picture_is_an_error_or_a_counted_skip(tmp_path, write_picture, play):
    for i in range(3):
        write_picture(tmp_path / f"{i}.png", i)
    (tmp_path / "0.png").write_bytes(b"damaged")

    with pytest.raises(SourceError, match=r"0\.png: unreadable picture"):
        play(folder(tmp_path, rate_hz=1))

    source = folder(tmp_path, rate_hz=1, on_bad_frame="skip")
    assert values(play(source)) == [1, 2]
    assert source.counters() == {"skipped": 1}


def test_a_folder_of_unreadable_pictures_is_refused_even_when_skipping(tmp_path):
    (tmp_path / "0.png").write_bytes(b"damaged")

    with pytest.raises(SourceError, match=r"0\.png: unreadable picture"):
        folder(tmp_path, rate_hz=1, on_bad_frame="skip").start(Session())


@pytest.mark.parametrize("change", [{"size": (10, 8)}, {"colour": True}, {"dtype": np.uint16}])
def test_a_picture_of_another_form_is_an_error_or_a_counted_skip(tmp_path, write_picture, play, change):
    write_picture(tmp_path / "0.png")
    write_picture(tmp_path / "1.png", **change)

    with pytest.raises(SourceError, match=r"1\.png: a picture of .* after pictures of 12x8 grey, 8 bit"):
        play(folder(tmp_path, rate_hz=1))

    assert len(play(folder(tmp_path, rate_hz=1, on_bad_frame="skip"))) == 1


def test_pictures_of_16_bit_stay_so(tmp_path, write_picture, play):
    write_picture(tmp_path / "0.png", 5000, dtype=np.uint16)

    (frame,) = play(folder(tmp_path, rate_hz=1))

    assert frame.payload.pixels.dtype == np.uint16
    assert values([frame]) == [5000]


def test_grey_makes_a_mixed_folder_even(tmp_path, write_picture, play):
    write_picture(tmp_path / "0.png")
    write_picture(tmp_path / "1.png", colour=True)

    assert values(play(folder(tmp_path, rate_hz=1, grey=True))) == [7, 7]


def test_a_table_of_poses_is_the_ground_truth(tmp_path, write_picture, play):
    for i in range(2):
        write_picture(tmp_path / "frames" / f"{i}.png")
    (tmp_path / "poses.csv").write_text("x;y;theta\n1000;0;90\n1000;500;180\n")
    source = folder(
        tmp_path / "frames",
        rate_hz=2,
        poses=tmp_path / "poses.csv",
        poses_metres_per_unit=0.001,
        poses_angle_unit="deg",
    )
    play(source)

    truth = source.ground_truth()

    assert truth is not None
    np.testing.assert_allclose(truth.stamps_s, [0.0, 0.5])
    np.testing.assert_allclose(truth.poses, [[1, 0, np.pi / 2], [1, 0.5, -np.pi]])
