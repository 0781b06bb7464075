"""The live source against a robot of its own making."""

from __future__ import annotations

import itertools
import logging
import math
import re
import threading
import time

import cv2
import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="the extra [ros2] is not installed")


from trailmark.api import create
from trailmark.errors import SourceError
from trailmark.frames import DepthCamera, Pinhole
from trailmark.interfaces import Session
from trailmark.pipeline import Pipeline
from trailmark.sources.ros_messages import lens
from trailmark_ros2 import dds
from trailmark_ros2.message_types import new_message

GREY = np.random.default_rng(7).integers(0, 255, (48, 64), dtype=np.uint8)
BGR = np.random.default_rng(8).integers(0, 255, (48, 64, 3), dtype=np.uint8)
VECTOR = "geometry_msgs/msg/Vector3"


@pytest.fixture
def started(domain):
    sources = []

    def start(*, mode="track", session=None, **keys):
        source = create("source", "ros2", domain=domain, **keys)
        sources.append(source)
        source.start(session or Session("robot", mode))
        return source

    yield start
    for source in sources:
        source.close()


def first_of(source, sensor):
    return next(frame for frame in source.frames() if frame.sensor == sensor)


def lens_message(messages, fx: float):
    k = np.array([fx, 0.0, 31.5, 0.0, fx, 23.5, 0.0, 0.0, 1.0])
    p = np.array([fx, 0.0, 31.5, 0.0, 0.0, fx, 23.5, 0.0, 0.0, 0.0, 1.0, 0.0])
    fields = {"header": messages.header(), "k": k, "p": p, "distortion_model": "plumb_bob", "d": np.zeros(5)}
    return new_message("sensor_msgs/msg/CameraInfo", fields)


@pytest.mark.parametrize(
    ("encoding", "sent", "expected"),
    [
        ("mono8", GREY, GREY),
        ("bgr8", BGR, BGR),
        ("rgb8", BGR[:, :, ::-1], BGR),
        ("16UC1", GREY.astype(np.uint16) * 100, GREY.astype(np.uint16) * 100),
        ("bayer_rggb8", np.full((48, 64), 90, np.uint8), np.full((48, 64, 3), 90, np.uint8)),
    ],
)
def test_pictures_come_as_they_were_sent(robot, messages, started, encoding, sent, expected) -> None:
    robot.repeat("/image_raw", 30.0, lambda k: messages.image(sent, encoding))

    source = started(topics={"front": "/image_raw"})
    frame = first_of(source, "front")

    assert np.array_equal(frame.payload.pixels, expected)
    assert source.sensors["front"].size == (64, 48)
    assert abs(time.time() - frame.stamp_s) < 2.0


def test_a_red_picture_of_a_bayer_camera_is_red(robot, messages, started) -> None:
    """Red light reaches the pixels of even rows and columns in the pattern rggb."""
    raw = np.zeros((48, 64), np.uint8)
    raw[0::2, 0::2] = 200
    robot.repeat("/image_raw", 30.0, lambda k: messages.image(raw, "bayer_rggb8"))

    pixels = first_of(started(topics={"front": "/image_raw"}), "front").payload.pixels

    assert pixels[10:38, 10:54, 2].mean() > 190
    assert pixels[10:38, 10:54, :2].max() == 0


def test_compressed_pictures_are_decoded(robot, messages, started) -> None:
    data = cv2.imencode(".png", BGR)[1].ravel()
    robot.repeat(
        "/image_raw/compressed",
        30.0,
        lambda k: new_message(
            "sensor_msgs/msg/CompressedImage", {"header": messages.header(), "format": "png", "data": data}
        ),
    )

    frame = first_of(started(topics={"front": "/image_raw/compressed"}), "front")

    assert np.array_equal(frame.payload.pixels, BGR)


def test_the_lens_comes_from_beside_the_pictures(robot, messages, started) -> None:
    robot.repeat("/front/image_raw", 30.0, lambda k: messages.image(GREY, "mono8"))
    robot.repeat("/front/camera_info", 30.0, lambda k: lens_message(messages, 55.0))

    source = started(topics={"front": "/front/image_raw"})

    assert source.sensors["front"].calibration == Pinhole(55.0, 55.0, 31.5, 23.5)


@pytest.mark.parametrize("field", ["k", "d"])
def test_a_lens_of_no_numbers_is_none(messages, field) -> None:
    message = lens_message(messages, 60.0)
    getattr(message, field)[2] = math.nan

    assert lens(message, is_rectified=False) is None


def test_colour_and_depth_become_one_reading(robot, messages, started) -> None:
    depth_m = np.full((48, 64), 2.5, np.float32)
    depth_m[0, 0] = np.nan
    shared: dict[int, float] = {}

    def stamp(k: int) -> float:
        return shared.setdefault(k, time.time())

    robot.repeat("/rgb/image", 30.0, lambda k: messages.image(BGR, "bgr8", stamp_s=stamp(k)))
    robot.repeat("/rgb/camera_info", 30.0, lambda k: lens_message(messages, 55.0))
    robot.repeat("/depth/image", 30.0, lambda k: messages.image(depth_m, "32FC1", stamp_s=stamp(k)))

    source = started(rgbd={"eye": {"colour": "/rgb/image", "depth": "/depth/image"}})
    frame = first_of(source, "eye")

    assert source.sensors["eye"].kind == "rgbd"
    assert source.sensors["eye"].calibration == DepthCamera(Pinhole(55.0, 55.0, 31.5, 23.5))
    assert np.array_equal(frame.payload.bgr, BGR)
    assert np.array_equal(frame.payload.depth_m, depth_m, equal_nan=True)


def test_scans_imu_and_poses_are_read(robot, messages, started) -> None:
    ranges = np.array([0.05, 1.0, 2.0, 99.0], np.float32)
    scan = {"angle_min": -0.5, "angle_increment": 0.25, "range_min": 0.1, "range_max": 10.0, "ranges": ranges}
    rates = new_message(VECTOR, {"x": 0.1, "y": 0.2, "z": 0.3})
    gps = {"latitude": 52.0, "longitude": 4.0}
    robot.repeat("/scan", 20, lambda k: new_message("sensor_msgs/msg/LaserScan", {"header": messages.header(), **scan}))
    robot.repeat(
        "/imu",
        50,
        lambda k: new_message("sensor_msgs/msg/Imu", {"header": messages.header(), "angular_velocity": rates}),
    )
    robot.repeat("/gps", 5, lambda k: new_message("sensor_msgs/msg/NavSatFix", {"header": messages.header(), **gps}))
    robot.repeat("/mocap", 20, lambda k: messages.pose_with_covariance(1.0, 2.0, 0.5, np.eye(6).ravel() * 0.01))

    source = started(topics={"laser": "/scan", "imu": "/imu", "gps": "/gps", "mocap": "/mocap"})
    seen = {}
    for frame in source.frames():
        seen.setdefault(frame.sensor, frame.payload)
        if len(seen) == 4:
            break

    assert {name: info.kind for name, info in source.sensors.items()} == {
        "laser": "scan",
        "imu": "imu",
        "gps": "pose",
        "mocap": "pose",
    }
    assert np.array_equal(seen["laser"].ranges_m, [np.nan, 1.0, 2.0, np.nan], equal_nan=True)
    np.testing.assert_allclose(seen["imu"].angular_velocity_radps, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(seen["mocap"].arrays["pose"], [1.0, 2.0, 0.5])
    np.testing.assert_allclose(seen["mocap"].arrays["covariance"], np.eye(3) * 0.01)
    np.testing.assert_allclose(seen["gps"].arrays["pose"], [0.0, 0.0, 0.0])


def test_a_slice_of_a_cloud_is_a_scan(robot, messages, started) -> None:
    points = np.array([[2.0, 0.0, 0.0], [1.0, 0.0, 0.5], [0.0, 3.0, 0.01], [np.nan, 0.0, 0.0]], np.float32)
    field = "sensor_msgs/msg/PointField"
    fields = [
        new_message(field, {"name": name, "offset": 4 * i, "datatype": 7, "count": 1}) for i, name in enumerate("xyz")
    ]
    cloud = {"height": 1, "width": 4, "point_step": 12, "row_step": 48, "fields": fields, "is_dense": False}
    robot.repeat(
        "/points",
        20,
        lambda k: new_message(
            "sensor_msgs/msg/PointCloud2",
            {"header": messages.header(), "data": points.view(np.uint8).ravel(), **cloud},
        ),
    )

    scan = first_of(started(topics={"laser": {"topic": "/points", "angle_step_deg": 1.0}}), "laser").payload

    seen = {round(math.degrees(angle)): r for angle, r in zip(scan.angles(), scan.ranges_m) if np.isfinite(r)}
    assert seen == {0: 2.0, 90: 3.0}  # the nearer point is above the slice


def test_a_robot_that_tells_its_odometry_by_transforms_alone(domain, new_robot, messages, started) -> None:
    def link(parent: str, child: str, x: float):
        pose = messages.pose(x, 0.0, 0.1)
        fields = {"translation": new_message(VECTOR, {"x": x}), "rotation": pose.orientation}
        transform = new_message("geometry_msgs/msg/Transform", fields)
        keys = {"header": messages.header(frame_id=parent), "child_frame_id": child, "transform": transform}
        return new_message("geometry_msgs/msg/TransformStamped", keys)

    def tree(*links):
        return new_message("tf2_msgs/msg/TFMessage", {"transforms": list(links)})

    # Who localizes sends on the same topic, and is another program.
    new_robot(domain).repeat("/tf", 50, lambda k: tree(link("map", "odom", 70.0 + k)))
    new_robot(domain).repeat("/tf", 50, lambda k: tree(link("odom", "base_link", 5.0 + 0.01 * k), link("a", "b", 9.0)))
    source = started(topics={"wheels": "/tf"})

    readings = [frame.payload for frame in itertools.islice(source.frames(), 20)]

    ways_m = [math.hypot(reading.pose_start_base.x, reading.pose_start_base.y) for reading in readings]
    np.testing.assert_allclose(np.diff(ways_m[1:]), 0.01, atol=0.021)  # one may be lost at the start
    assert {reading.twist for reading in readings} == {None}
    assert not source.counters().get("other_writer.wheels")
    assert source.sensors["wheels"].kind == "odometry"


def test_velocities_are_integrated(robot, messages, started) -> None:
    twist = new_message("geometry_msgs/msg/Twist", {"linear": new_message(VECTOR, {"x": 0.5})})
    began_s = time.time()
    robot.repeat(
        "/twist",
        50,
        lambda k: new_message(
            "geometry_msgs/msg/TwistStamped", {"header": messages.header(began_s + 0.02 * k), "twist": twist}
        ),
    )

    frames = list(itertools.islice(started(topics={"wheels": "/twist"}).frames(), 40))

    way_m = frames[-1].payload.pose_start_base.x - frames[0].payload.pose_start_base.x
    assert way_m == pytest.approx(0.5 * (frames[-1].stamp_s - frames[0].stamp_s), abs=1e-6)


def test_odometry_counts_from_our_start_and_through_a_restart(robot, messages, started) -> None:
    robot.send("/odom", messages.odometry(5.0, 1.0))
    source = started(topics={"wheels": "/odom"}, start_timeout_s=5.0, silence_s=0.2)
    frames = source.frames()
    xs = []
    for x in (5.0, 5.1, 5.2, 0.0, 0.1):  # at 0.0 the driver was started again
        robot.send("/odom", messages.odometry(x, 1.0 if x >= 5.0 else 0.0))
        xs.append(next(frames).payload.pose_start_base.x)

    np.testing.assert_allclose(xs, [0.0, 0.1, 0.2, 0.2, 0.3], atol=1e-9)
    assert source.counters()["restarts.wheels"] == 1


def test_of_two_programs_that_send_one_topic_the_first_counts(domain, new_robot, messages, started, caplog) -> None:
    first, second = new_robot(domain), new_robot(domain)
    first.repeat("/odom", 50.0, lambda k: messages.odometry(0.01 * k))
    source = started(topics={"wheels": "/odom"}, silence_s=1.0)
    frames = source.frames()
    next(frames)
    second.repeat("/odom", 50.0, lambda k: messages.odometry(30.0 + 0.01 * k))
    places = []
    while source.counters().get("other_writer.wheels", 0) < 20:
        places.append(next(frames).payload.pose_start_base.x)

    assert caplog.text.count("/odom is sent by two programs at once") == 1
    assert max(abs(b - a) for a, b in itertools.pairwise(places)) < 0.1
    first.die()
    later = [next(frames).payload.pose_start_base.x for _ in range(5)]  # it goes on from where the robot was
    assert abs(later[0] - places[-1]) < 1.0


@pytest.mark.parametrize("code", ["<u2", ">u2"])
def test_rows_that_are_padded_and_bytes_in_either_order_are_read(robot, messages, started, code) -> None:
    sent = (251 * GREY.astype(np.uint16))[:, :50]
    message = messages.image(sent.astype(code), "mono16")
    rows = np.pad(message.data.reshape(48, 100), ((0, 0), (0, 28)), constant_values=255)
    message.step, message.is_bigendian, message.data = 128, int(code[0] == ">"), rows.ravel()

    def stamped(k):
        message.header = messages.header()
        return message

    robot.repeat("/image", 30.0, stamped)
    frame = first_of(started(topics={"front": "/image"}), "front")

    np.testing.assert_array_equal(frame.payload.pixels, sent)


def test_a_robot_that_dies_and_comes_back_goes_on(domain, new_robot, messages, started, caplog) -> None:
    robot = new_robot(domain)
    robot.repeat("/odom", 50.0, lambda k: messages.odometry(0.01 * k))
    source = started(topics={"wheels": "/odom"}, silence_s=0.5)
    frames = source.frames()
    last = next(frames)
    threading.Timer(0.2, robot.die).start()

    def come_back() -> None:
        again = new_robot(domain)
        again.repeat("/odom", 50.0, lambda k: messages.odometry(0.01 * k))

    coming_back = threading.Timer(2.0, come_back)
    coming_back.start()
    with caplog.at_level(logging.WARNING):
        gap_s = 0.0
        while gap_s < 1.0:
            frame = next(frames)
            gap_s, last = frame.stamp_s - last.stamp_s, frame
    coming_back.join()

    assert "/odom is silent for" in caplog.text
    assert "/odom is back after" in caplog.text


def test_a_writer_that_comes_back_as_best_effort_is_read_too(domain, new_robot, messages, started) -> None:
    robot = new_robot(domain)
    robot.repeat("/odom", 50.0, lambda k: messages.odometry(), dds.Quality(is_reliable=True))
    source = started(topics={"wheels": "/odom"}, silence_s=0.5)
    frames = source.frames()
    next(frames)
    robot.die()
    again = new_robot(domain)

    again.repeat("/odom", 50.0, lambda k: messages.odometry(1.0), dds.Quality(is_reliable=False))

    began_s = time.time()
    assert next(frame for frame in frames if frame.stamp_s > began_s).sensor == "wheels"


def test_a_best_effort_writer_that_takes_its_time_is_read_too(domain, new_robot, messages, started) -> None:
    """It comes when the silence has been said already."""
    robot = new_robot(domain)
    robot.repeat("/odom", 50.0, lambda k: messages.odometry(), dds.Quality(is_reliable=True))
    source = started(topics={"wheels": "/odom"}, silence_s=0.3, end_when_silent_s=8.0)
    frames = source.frames()
    next(frames)
    robot.die()
    again = []

    def come_back() -> None:
        again.append(new_robot(domain))
        again[0].repeat("/odom", 50.0, lambda k: messages.odometry(1.0), dds.Quality(is_reliable=False))

    threading.Timer(2.0, come_back).start()

    began_s = time.time() + 1.0
    assert any(frame.stamp_s > began_s for frame in frames)


def test_a_type_that_does_not_fit_is_said_with_both_names(robot, messages, started) -> None:
    robot.repeat("/odom", 20.0, lambda k: messages.odometry())

    with pytest.raises(SourceError, match=r"/odom is sent as nav_msgs/msg/Odometry, .* asks for sensor_msgs/msg/Imu"):
        started(topics={"wheels": {"topic": "/odom", "type": "sensor_msgs/msg/Imu"}})


def test_a_type_that_is_not_understood_is_said(robot, started) -> None:
    robot.repeat("/chatter", 20.0, lambda k: new_message("std_msgs/msg/String", {"data": "hi"}))

    with pytest.raises(SourceError, match="/chatter is sent as std_msgs/msg/String; understood are"):
        started(topics={"wheels": "/chatter"})


def test_a_topic_that_nobody_sends_is_said_with_those_that_are_there(robot, messages, started) -> None:
    robot.repeat("/odom", 20.0, lambda k: messages.odometry())

    with pytest.raises(SourceError, match=r"/odo: nobody sends it \(did you mean /odom\?\)"):
        started(topics={"wheels": "/odo"}, start_timeout_s=1.0)


def test_an_empty_domain_is_said(started) -> None:
    with pytest.raises(SourceError, match="nothing at all is seen in ROS domain"):
        started(topics={"wheels": "/odom"}, start_timeout_s=0.5)


def test_what_is_missing_is_said_before_it_is_given_up(started, caplog) -> None:
    with caplog.at_level(logging.WARNING), pytest.raises(SourceError):
        started(topics={"wheels": "/odom"}, silence_s=0.2, start_timeout_s=0.6)

    assert "waiting for the robot: /odom: nothing at all" in caplog.text


def test_messages_that_are_broken_are_counted_and_end_nothing(robot, messages, started) -> None:
    robot.repeat("/image_raw", 50.0, lambda k: messages.image(GREY, "mono8"))
    source = started(topics={"front": "/image_raw"})
    wrong = messages.image(GREY, "mono8")
    wrong.height = 4_000_000_000
    robot.send("/image_raw", wrong)
    robot.send("/image_raw", messages.image(GREY, "no_such_encoding"))

    frames = list(itertools.islice(source.frames(), 30))

    assert len(frames) == 30
    assert source.counters()["skipped.front"] == 2


def test_messages_none_of_which_can_be_used_are_not_called_silence(robot, messages, started) -> None:
    robot.repeat("/odom", 50.0, lambda k: messages.odometry(stamp_s=0.0))

    with pytest.raises(SourceError, match=r"\d+ messages came, and none could be used: the header's stamp is empty"):
        started(topics={"wheels": "/odom"}, silence_s=2.0, start_timeout_s=1.0)


def test_a_velocity_that_is_no_number_is_not_known(robot, messages, started) -> None:
    def message(k):
        odometry = messages.odometry(0.01 * k)
        odometry.twist.twist.angular.z = math.nan
        return odometry

    robot.repeat("/odom", 50.0, message)
    frame = next(started(topics={"wheels": "/odom"}).frames())

    assert frame.payload.twist is None


def test_stamps_of_another_clock_are_measured_and_told(robot, messages, started, caplog) -> None:
    robot.repeat("/odom", 50.0, lambda k: messages.odometry(stamp_s=time.time() + 3.1))
    source = started(topics={"wheels": "/odom"})
    with caplog.at_level(logging.WARNING):
        frames = list(itertools.islice(source.frames(), 20))

    assert frames[-1].stamp_s - time.time() > 2.5
    assert source.counters()["offset_ms.wheels"] == pytest.approx(3100, abs=300)
    assert re.search(r"/odom: header stamps are (3.\d|2.9)\d* s ahead of this machine", caplog.text)


def test_stamps_of_arrival_ignore_the_clock_of_the_sender(robot, messages, started) -> None:
    robot.repeat("/odom", 50.0, lambda k: messages.odometry(stamp_s=12.0 + 0.02 * k))

    frame = next(started(topics={"wheels": "/odom"}, stamps="receive").frames())

    assert abs(frame.stamp_s - time.time()) < 2.0


def test_closing_from_another_thread_ends_the_frames(robot, messages, started) -> None:
    robot.repeat("/odom", 50.0, lambda k: messages.odometry())
    source = started(topics={"wheels": "/odom"})
    threading.Timer(0.3, source.close).start()

    began_s = time.monotonic()
    list(source.frames())

    assert time.monotonic() - began_s < 10.0


def test_a_source_ends_on_silence_where_that_is_asked_for(robot, messages, started) -> None:
    robot.repeat("/odom", 50.0, lambda k: messages.odometry())
    source = started(topics={"wheels": "/odom"}, end_when_silent_s=1.0)
    threading.Timer(0.3, robot.fall_silent).start()

    assert len(list(source.frames())) > 3


def test_a_pose_that_is_told_moves_the_belief(domain, robot, messages) -> None:
    robot.repeat("/odom", 50.0, lambda k: messages.odometry())
    config = {
        "sources": {
            "robot": {"plugin": "ros2", "domain": domain, "topics": {"wheels": "/odom"}, "initial_pose": "/initialpose"}
        },
        "localizers": {"wheels": {"plugin": "odometry"}},
        "estimator": {"plugin": "kalman"},
    }
    with Pipeline(config) as pipeline:
        for step in itertools.islice(pipeline, 500):
            robot.send("/initialpose", messages.pose_with_covariance(3.0, -2.0, 1.0, np.eye(6).ravel() * 0.01))
            pose = step.belief.pose_map_base
            if pose is not None and pose.x > 2.9:
                break

    np.testing.assert_allclose(pose.array(), [3.0, -2.0, 1.0], atol=1e-6)
