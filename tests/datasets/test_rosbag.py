"""Recordings of ROS 1 and ROS 2."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from trailmark.errors import SourceError
from trailmark.frames import DepthCamera, Pinhole
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import Session
from trailmark_datasets.config import RosbagConfig
from trailmark_datasets.rosbag import Rosbag

GREY = np.arange(12, dtype=np.uint8).reshape(3, 4)
BGR = np.arange(36, dtype=np.uint8).reshape(3, 4, 3)


def bag(path, **keys) -> Rosbag:
    return Rosbag(RosbagConfig.model_validate({"path": path, **keys}))


def of(frames, sensor):
    return [frame.payload for frame in frames if frame.sensor == sensor]


@pytest.mark.parametrize("kind", ["ros1", "sqlite", "mcap"])
def test_every_format_gives_the_same_frames(tmp_path, recording, play, kind):
    record = recording(kind)
    record.add("/cam/image_raw", record.image(1.0, GREY, "mono8"), 5.0)
    record.add("/odom", record.odometry(1.5, 10.0, 0.0, math.pi / 2), 5.1)
    record.add("/scan", record.scan(1.25, [0.1, 1.0, math.inf, math.nan, 9.0]), 5.2)
    record.add("/imu", record.imu(1.125), 5.3)
    record.add("/odom", record.odometry(2.5, 10.0, 2.0, math.pi / 2), 5.4)
    record.add("/chatter", record.text("not understood"), 5.5)
    source = bag(record.write(tmp_path))

    frames = play(source)

    assert {name: info.kind for name, info in source.sensors.items()} == {
        "cam_image_raw": "image",
        "odom": "odometry",
        "scan": "scan",
        "imu": "imu",
    }
    stamps = [frame.stamp_s for frame in frames]
    assert stamps == [1.0, 1.125, 1.25, 1.5, 2.5]  # those of the headers, in their order
    assert source.lasts_s() == pytest.approx(0.5)  # by the recorder's clock
    np.testing.assert_array_equal(of(frames, "cam_image_raw")[0].pixels, GREY)
    assert of(frames, "odom")[0].pose_start_base == Pose2()
    np.testing.assert_allclose(of(frames, "odom")[1].pose_start_base.array(), [2.0, 0.0, 0.0], atol=1e-12)
    assert of(frames, "odom")[1].twist == Twist2(0.5, 0.1, 0.2)
    (scan,) = of(frames, "scan")
    np.testing.assert_array_equal(scan.ranges_m, np.array([np.nan, 1.0, np.nan, np.nan, 9.0], np.float32))
    assert (scan.angle_min_rad, scan.angle_step_rad, scan.range_max_m) == (-1.0, 0.5, 10.0)
    (imu,) = of(frames, "imu")
    np.testing.assert_array_equal(imu.angular_velocity_radps, [1, 2, 3])
    np.testing.assert_array_equal(imu.linear_acceleration_mps2, [4, 5, 6])
    np.testing.assert_allclose(imu.quat_xyzw, [0, 0, math.sqrt(0.5), math.sqrt(0.5)])


def test_a_folder_of_bags_is_one_recording(tmp_path, recording, play):
    for part in (1, 2):
        record = recording()
        record.add("/odom", record.odometry(float(part), part, 0.0, 0.0), float(part))
        (tmp_path / f"{part}").mkdir()
        record.write(tmp_path / f"{part}").rename(tmp_path / f"part_{part}.bag")

    frames = play(bag(tmp_path))

    assert [frame.payload.pose_start_base.x for frame in frames] == [0.0, 1.0]


ENCODINGS = {
    "bgr8": (BGR, BGR),
    "rgb8": (BGR[:, :, ::-1], BGR),
    "8UC3": (BGR, BGR),
    "bgra8": (np.dstack([BGR, GREY]), BGR),
    "rgba8": (np.dstack([BGR[:, :, ::-1], GREY]), BGR),
    "8UC1": (GREY, GREY),
    "16UC1": (GREY.astype(np.uint16) * 300, GREY.astype(np.uint16) * 300),
    "mono16": (GREY.astype(np.uint16) * 300, GREY.astype(np.uint16) * 300),
}


@pytest.mark.parametrize("padding", [0, 6])
@pytest.mark.parametrize("encoding", ENCODINGS)
def test_raw_pictures_are_read_in_every_encoding(tmp_path, recording, play, encoding, padding):
    stored, expected = ENCODINGS[encoding]
    record = recording()
    record.add("/cam", record.image(1.0, stored, encoding, padding=padding), 1.0)
    source = bag(record.write(tmp_path), topics={"front": "/cam"})

    (frame,) = play(source)

    np.testing.assert_array_equal(frame.payload.pixels, expected)
    assert frame.payload.pixels.dtype == expected.dtype
    assert source.sensors["front"].size == (4, 3)


def test_big_endian_pictures_are_turned_round(tmp_path, recording, play):
    wide = GREY.astype(np.uint16) * 300
    record = recording()
    record.add("/cam", record.image(1.0, wide.astype(">u2"), "mono16", big=True), 1.0)

    (frame,) = play(bag(record.write(tmp_path)))

    np.testing.assert_array_equal(frame.payload.pixels, wide)


@pytest.mark.parametrize(("suffix", "format_"), [(".png", "bgr8; png compressed bgr8"), (".jpg", "jpeg")])
def test_compressed_pictures_are_decoded(tmp_path, recording, play, suffix, format_):
    smooth = np.full((16, 16, 3), (10, 100, 200), np.uint8)
    record = recording("mcap")
    record.add("/cam/compressed", record.compressed(1.0, cv2.imencode(suffix, smooth)[1].tobytes(), format_), 1.0)

    (frame,) = play(bag(record.write(tmp_path)))

    np.testing.assert_allclose(frame.payload.pixels.astype(int), smooth, atol=3)


def test_named_topics_are_the_only_sensors(tmp_path, recording, play):
    record = recording()
    record.add("/odom", record.odometry(1.0, 0, 0, 0), 1.0)
    record.add("/imu", record.imu(1.0), 1.0)
    source = bag(record.write(tmp_path), topics={"wheels": "/odom"})

    play(source)

    assert list(source.sensors) == ["wheels"]


def test_numbers_that_an_imu_does_not_measure_are_none(tmp_path, recording, play):
    record = recording()
    record.add("/imu", record.imu(1.0, unknown=True), 1.0)

    (frame,) = play(bag(record.write(tmp_path)))

    assert frame.payload.linear_acceleration_mps2 is None
    assert frame.payload.quat_xyzw is None


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (
            {"topics": {"wheels": "/odm"}},
            r"a\.bag: no messages on topic '/odm' \(did you mean '/odom'\?\); topics: /chatter ",
        ),
        (
            {"topics": {"words": "/chatter"}},
            r"topic '/chatter' is of type std_msgs/msg/String; understood here: ",
        ),
        ({"rgbd": {"kinect": {"colour": "/rgb", "depth": "/odom"}}}, r"no messages on topic '/rgb'"),
        (
            {"rgbd": {"kinect": {"colour": "/odom", "depth": "/odom"}}},
            r"topic '/odom' is of type nav_msgs/msg/Odom",
        ),
        ({"topics": {}}, "no topic is understood; topics: /chatter"),
    ],
)
def test_a_topic_that_does_not_fit_is_refused_naming_what_is_there(tmp_path, recording, keys, message):
    record = recording()
    record.add("/odom", record.odometry(1.0, 0, 0, 0), 1.0)
    record.add("/chatter", record.text("x"), 1.0)

    with pytest.raises(SourceError, match=message):
        bag(record.write(tmp_path), **keys).start(Session())


def test_topics_that_make_the_same_name_must_be_named(tmp_path, recording):
    record = recording()
    record.add("/a/b", record.imu(1.0), 1.0)
    record.add("/a_b", record.imu(1.0), 1.0)

    with pytest.raises(SourceError, match="topics /a/b and /a_b both make a sensor 'a_b'; name them in topics"):
        bag(record.write(tmp_path)).start(Session())


@pytest.mark.parametrize("name", ["a.bag", "a.mcap", "a.db3"])
def test_a_file_that_is_no_recording_is_refused(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(b"no recording at all")

    with pytest.raises(SourceError, match=rf"{name}: cannot open the recording"):
        bag(path).start(Session())


def test_a_recording_that_is_cut_off_is_refused(tmp_path, recording):
    record = recording()
    for i in range(50):
        record.add("/odom", record.odometry(1.0 + i, 0, 0, 0), 1.0 + i)
    path = record.write(tmp_path)
    path.write_bytes(path.read_bytes()[:-3000])

    with pytest.raises(
        SourceError, match=r"a\.bag: cannot open the recording: .*`rosbag reindex` makes its index anew"
    ):
        bag(path).start(Session())


def test_damaged_data_inside_a_recording_are_an_error(tmp_path, recording, play):
    record = recording()
    for i in range(50):
        record.add("/odom", record.odometry(1.0 + i, 0, 0, 0), 1.0 + i)
    path = record.write(tmp_path)
    data = bytearray(path.read_bytes())
    position = data.find(b"base_link", 10_000) - 4
    data[position : position + 4] = b"\xff\xff\xff\x7f"  # a string of 2 GB
    path.write_bytes(bytes(data))

    with pytest.raises(SourceError, match=r"a\.bag: message \d+ of /odom cannot be decoded"):
        play(bag(path))
    assert len(play(bag(path, on_bad_frame="skip"))) == 49


def test_a_recording_whose_records_are_damaged_is_an_error_even_when_skipping(tmp_path, recording, play):
    record = recording()
    for i in range(50):
        record.add("/odom", record.odometry(1.0 + i, 0, 0, 0), 1.0 + i)
    path = record.write(tmp_path)
    data = bytearray(path.read_bytes())
    position = data.find(b"base_link", 20_000)
    data[position : position + 1000] = b"\xff" * 1000  # the lengths of the next record among them
    path.write_bytes(bytes(data))

    with pytest.raises(SourceError, match=r"a\.bag is damaged"):
        play(bag(path, on_bad_frame="skip"))


def test_an_empty_header_stamp_asks_for_receive_times(tmp_path, recording, play):
    record = recording()
    record.add("/odom", record.odometry(0.0, 0, 0, 0), 7.0)
    record.add("/odom", record.odometry(0.0, 1, 0, 0), 8.0)
    path = record.write(tmp_path)

    with pytest.raises(SourceError, match="message 0 of /odom: the header's stamp is empty; set stamps: receive"):
        play(bag(path))

    assert [frame.stamp_s for frame in play(bag(path, stamps="receive"))] == [7.0, 8.0]


def test_a_stamp_that_goes_back_is_an_error_or_a_counted_skip(tmp_path, recording, play):
    record = recording()
    for stamp_s, receive_s in ((1.0, 1.0), (3.0, 2.0), (2.0, 3.0)):
        record.add("/odom", record.odometry(stamp_s, stamp_s, 0, 0), receive_s)
    path = record.write(tmp_path)

    with pytest.raises(SourceError, match=r"a\.bag: message 2 of /odom: the stamp goes back: 2\.0+ s after 3\.0+ s"):
        play(bag(path))

    source = bag(path, on_bad_frame="skip")
    assert [frame.stamp_s for frame in play(source)] == [1.0, 3.0]
    assert source.counters() == {"skipped": 1}


def test_clocks_that_differ_are_an_error(tmp_path, recording, play):
    record = recording()
    for i in range(20):
        record.add("/imu", record.imu(100.0 + i), 0.1 * i)
        record.add("/odom", record.odometry(1.0 + i, 0, 0, 0), 0.1 * i + 0.05)

    with pytest.raises(SourceError, match="frame of sensor 'odom' comes too late to be put in order"):
        play(bag(record.write(tmp_path)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"data": np.zeros((3, 5), np.uint8)}, "a picture of 5x3 grey, 8 bit after pictures of 4x3 grey, 8 bit"),
        ({"encoding": "yuv422"}, "encoding 'yuv422' is not understood; understood: mono8"),
        ({"encoding": "rgb8"}, "12 bytes are no 4x3 picture of rgb8 with 4 bytes a row"),
        ({"encoding": "32FC1", "data": GREY.astype(np.float32)}, "is depth; pair it with its colour"),
    ],
)
def test_a_bad_picture_is_an_error_or_a_counted_skip(tmp_path, recording, play, change, message):
    record = recording()
    record.add("/cam", record.image(1.0, GREY, "mono8"), 1.0)
    record.add("/cam", record.image(2.0, **({"data": GREY, "encoding": "mono8"} | change)), 2.0)
    path = record.write(tmp_path)

    with pytest.raises(SourceError, match=rf"a\.bag: message 1 of /cam.*{message}"):
        play(bag(path))
    assert len(play(bag(path, on_bad_frame="skip"))) == 1


def test_a_pose_that_is_not_finite_is_an_error(tmp_path, recording, play):
    record = recording()
    record.add("/odom", record.odometry(1.0, math.nan, 0, 0), 1.0)

    with pytest.raises(SourceError, match="message 0 of /odom cannot be used: pose is not finite"):
        play(bag(record.write(tmp_path)))


def test_topics_that_cannot_be_read_are_left_out_unless_they_are_named(tmp_path, recording, play):
    record = recording()
    record.add("/depth", record.image(1.0, GREY.astype(np.float32), "32FC1"), 1.0)
    path = record.write(tmp_path)

    with pytest.raises(SourceError, match="no topic could be read; name them in topics or rgbd"):
        bag(path).start(Session())
    with pytest.raises(SourceError, match="message 0 of /depth is depth; pair it with its colour: rgbd"):
        bag(path, topics={"depth": "/depth"}).start(Session())


def kinect(record, depth, encoding, lag_s=0.0, frame_id="rgb_frame"):
    for i in range(3):
        record.add("/rgb/image", record.image(1.0 + 0.1 * i, BGR, "bgr8", frame_id="rgb_frame"), 1.0 + 0.1 * i)
        picture = record.image(1.005 + 0.1 * i, depth, encoding, frame_id=frame_id)
        record.add("/depth/image", picture, 1.005 + 0.1 * i + lag_s)
    record.add("/rgb/camera_info", record.info(500.0), 1.5)


KINECT = {"kinect": {"colour": "/rgb/image", "depth": "/depth/image"}}


@pytest.mark.parametrize("lag_s", [0.0, 0.25])
@pytest.mark.parametrize(
    ("depth", "encoding"),
    [(GREY.astype(np.uint16) * 100, "16UC1"), (GREY.astype(np.float32) / 10, "32FC1")],
)
def test_colour_and_depth_make_frames_of_metres(tmp_path, recording, play, depth, encoding, lag_s):
    record = recording()
    kinect(record, depth, encoding, lag_s)
    source = bag(record.write(tmp_path), rgbd=KINECT)

    frames = play(source)

    assert [frame.stamp_s for frame in frames] == pytest.approx([1.0, 1.1, 1.2])
    assert list(source.sensors) == ["kinect"]
    expected = GREY.astype(np.float32) / 10
    expected[0, 0] = np.nan
    np.testing.assert_allclose(frames[0].payload.depth_m, expected, rtol=1e-6)
    np.testing.assert_array_equal(frames[0].payload.bgr, BGR)
    assert source.sensors["kinect"].calibration == DepthCamera(Pinhole(500.0, 500.0, 2.0, 1.0))
    assert source.counters()["unpaired_kinect"] == 0


def test_depth_in_another_frame_is_not_taken_as_registered(tmp_path, recording):
    record = recording()
    kinect(record, GREY.astype(np.uint16), "16UC1", frame_id="ir_frame")
    source = bag(record.write(tmp_path), rgbd=KINECT)

    source.start(Session())

    assert source.sensors["kinect"].calibration is None


def test_compressed_depth_loses_its_header(tmp_path, recording, play):
    depth = GREY.astype(np.uint16) * 100
    record = recording()
    record.add("/rgb/image", record.image(1.0, BGR, "bgr8"), 1.0)
    data = b"\0" * 12 + cv2.imencode(".png", depth)[1].tobytes()
    record.add("/depth/compressedDepth", record.compressed(1.0, data, "16UC1; compressedDepth png"), 1.0)
    source = bag(record.write(tmp_path), rgbd={"kinect": {"colour": "/rgb/image", "depth": "/depth/compressedDepth"}})

    (frame,) = play(source)

    assert float(frame.payload.depth_m[2, 3]) == pytest.approx(1.1)


def test_compressed_depth_of_floats_is_refused(tmp_path, recording):
    record = recording()
    record.add("/rgb/image", record.image(1.0, BGR, "bgr8"), 1.0)
    record.add("/depth/compressedDepth", record.compressed(1.0, b"x" * 99, "32FC1; compressedDepth png"), 1.0)
    pair = {"colour": "/rgb/image", "depth": "/depth/compressedDepth"}

    with pytest.raises(SourceError, match="message 0 of /depth/compressedDepth: compressed depth of 32FC1"):
        bag(record.write(tmp_path), rgbd={"kinect": pair}).start(Session())


def test_a_first_picture_that_is_bad_is_skipped_too(tmp_path, recording, play):
    record = recording()
    record.add("/cam", record.image(1.0, GREY, "yuv422"), 1.0)
    record.add("/cam", record.image(2.0, GREY, "mono8"), 2.0)
    source = bag(record.write(tmp_path), topics={"front": "/cam"}, on_bad_frame="skip")

    assert [frame.stamp_s for frame in play(source)] == [2.0]
    assert source.counters() == {"skipped": 1}


def test_colour_and_depth_that_never_meet_are_refused(tmp_path, recording):
    record = recording()
    record.add("/rgb/image", record.image(1.0, BGR, "bgr8"), 1.0)
    record.add("/depth/image", record.image(9.0, GREY.astype(np.uint16), "16UC1"), 9.0)

    with pytest.raises(SourceError, match="'kinect' has no colour and depth that make a pair"):
        bag(record.write(tmp_path), rgbd=KINECT).start(Session())


@pytest.mark.parametrize(
    ("info", "topic", "expected"),
    [
        ({"fx": 500.0}, "/cam/image_raw", Pinhole(500.0, 500.0, 2.0, 1.0)),
        (
            {"fx": 500.0, "distortion": (0.1, 0.2, 0, 0, 0)},
            "/cam/image_raw",
            Pinhole(500.0, 500.0, 2.0, 1.0, (0.1, 0.2, 0.0, 0.0, 0.0)),
        ),
        ({"fx": 500.0, "distortion": (0.1, 0.2, 0, 0, 0)}, "/cam/image_rect", Pinhole(501.0, 501.0, 2.0, 1.0)),
        ({"fx": 500.0, "distortion": (0.1, 0.2, 0, 0), "model": "equidistant"}, "/cam/image_raw", None),
        ({"fx": 0.0}, "/cam/image_raw", None),
    ],
    ids=["ideal", "distorted", "rectified", "fisheye", "uncalibrated"],
)
@pytest.mark.parametrize("kind", ["ros1", "sqlite"])
def test_the_lens_beside_a_picture_is_its_calibration(tmp_path, recording, kind, info, topic, expected):
    record = recording(kind)
    record.add(topic, record.image(1.0, GREY, "mono8"), 1.0)
    record.add("/cam/camera_info", record.info(**info), 1.0)
    source = bag(record.write(tmp_path), topics={"front": topic})

    source.start(Session())

    assert source.sensors["front"].calibration == expected


def test_an_unknown_distribution_is_refused(tmp_path):
    with pytest.raises(ValidationError, match="ros2_humble"):
        bag(tmp_path, distribution="ros3")


@pytest.mark.parametrize("kind", ["ros1", "sqlite"])
def test_an_orientation_of_zeros_is_refused(tmp_path, recording, play, kind):
    record = recording(kind)
    record.add("/odom", record.odometry(1.0, 1.0, 0.0, 0.0), 1.0)
    empty = record.odometry(2.0, 1.0, 0.0, 0.0)
    empty.pose.pose.orientation.w = empty.pose.pose.orientation.z = 0.0
    record.add("/odom", empty, 2.0)
    path = record.write(tmp_path)

    with pytest.raises(SourceError, match=r"message 1 of /odom cannot be used: .* quaternion \(0, 0, 0, 0\)"):
        play(bag(path))
    assert len(play(bag(path, on_bad_frame="skip"))) == 1


def test_an_index_whose_length_is_wrong_is_read_by_its_count(tmp_path, recording, play):
    record = recording("ros1")
    for index in range(5):
        record.add("/scan", record.scan(1.0 + index, [1.0, 2.0]), 1.0 + index)
    path = record.write(tmp_path)
    content = bytearray(path.read_bytes())
    length = content.index(b"op=\x04")
    length = content.index((5 * 12).to_bytes(4, "little"), length)
    content[length : length + 4] = (5 * 20).to_bytes(4, "little")  # as ROS's own early writers left it
    path.write_bytes(content)

    assert [frame.stamp_s for frame in play(bag(path))] == [1.0, 2.0, 3.0, 4.0, 5.0]


@pytest.mark.data
def test_a_recording_of_2010_is_read(data_folder, play):
    frames = play(bag(data_folder / "laser" / "scan_matcher_demo.bag"))

    assert len(frames) == 360
    assert frames[-1].stamp_s - frames[0].stamp_s == pytest.approx(36.0, abs=1.0)


def test_an_error_without_words_is_told_by_its_place(tmp_path, recording, monkeypatch):
    def refuse(*_: object) -> None:
        raise AssertionError

    record = recording("ros1")
    record.add("/scan", record.scan(1.0, [1.0]), 1.0)
    monkeypatch.setattr("trailmark_datasets.bagfile.BagFile", refuse)

    with pytest.raises(SourceError, match=r"its structure is wrong \(refuse of test_rosbag\.py could not go on\)"):
        bag(record.write(tmp_path)).start(Session())


@pytest.mark.parametrize(
    "wrong",
    [{"angle_min": math.nan}, {"angle_increment": math.inf}, {"angle_increment": 1e30}, {"angle_min": -1e18}],
)
def test_a_scan_whose_angles_are_none_is_an_error(tmp_path, recording, play, wrong):
    record = recording()
    record.add("/scan", record.scan(1.0, [1.0, 2.0]), 1.0)
    message = record.scan(2.0, [1.0, 2.0])
    for name, value in wrong.items():
        object.__setattr__(message, name, value)
    record.add("/scan", message, 2.0)
    path = record.write(tmp_path)

    with pytest.raises(SourceError, match=r"message 1 of /scan cannot be used: 2 beams from .* rad in steps of"):
        play(bag(path))
    assert len(play(bag(path, on_bad_frame="skip"))) == 1


def _quoting(inner: Exception) -> Exception:
    error = ValueError(f"Invalid bag metadata: {inner}")
    error.__context__ = inner
    return error


def _lacking(key: str) -> Exception:
    error = ValueError(f"A metadata key is missing {KeyError(key)!r}.")
    error.__context__ = KeyError(key)
    return error


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (UnicodeDecodeError("utf-8", b"\x8b", 0, 1, "invalid start byte"), "a text in it is not UTF-8"),
        (
            _quoting(UnicodeDecodeError("utf-8", b"\x8b", 0, 1, "invalid start byte")),
            "recording: a text in it is not UTF-8$",
        ),
        (MemoryError(), "a length in it is larger than the memory"),
        (_quoting(TypeError("x is not subscriptable")), "Invalid bag metadata: its structure is wrong"),
        (_quoting(IsADirectoryError(21, "Is a directory")), "Invalid bag metadata: Is a directory"),
        (_quoting(_quoting(KeyError("x"))), "Invalid bag metadata: it lacks 'x'$"),
        (_lacking("name"), "A metadata key is missing: it lacks 'name'$"),
        (
            ValueError("no grammar for 'abc'\nand more\n" * 99),
            r"a\.bag: cannot open the recording: no grammar for 'abc'$",
        ),
        (ValueError("long " * 99), r"long +\.\.\.$"),
        (
            IndexError("list index out of range"),
            r"its structure is wrong \(refuse of test_rosbag\.py could not go on\)",
        ),
    ],
)
def test_words_of_python_are_not_passed_on(tmp_path, recording, monkeypatch, error, words):
    def refuse(*_: object) -> None:
        raise error

    record = recording("ros1")
    record.add("/scan", record.scan(1.0, [1.0]), 1.0)
    monkeypatch.setattr("trailmark_datasets.bagfile.BagFile", refuse)

    with pytest.raises(SourceError, match=words):
        bag(record.write(tmp_path)).start(Session())
