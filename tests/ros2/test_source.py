"""The live source against a robot of its own making."""

from __future__ import annotations

import itertools
import math
import time

import cv2
import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="the extra [ros2] is not installed")


from trailmark.errors import SourceError
from trailmark.frames import DepthCamera, Pinhole
from trailmark.sources.ros_messages import lens, planar_pose, scan
from trailmark_ros2.config import TopicOptions
from trailmark_ros2.frame_names import FrameNames
from trailmark_ros2.message_types import new_message
from trailmark_ros2.readings import new_reader

GREY = np.random.default_rng(7).integers(0, 255, (48, 64), dtype=np.uint8)
BGR = np.random.default_rng(8).integers(0, 255, (48, 64, 3), dtype=np.uint8)
VECTOR = "geometry_msgs/msg/Vector3"


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


def test_a_message_of_another_frame_is_left_out_and_said(robot, messages, started, caplog) -> None:
    def odometry(k):
        message = messages.odometry(0.01 * k)
        if k % 2:  # its numbers are of another origin
            message.header.frame_id, message.pose.pose.position.y = "map", 4.0
        return message

    robot.repeat("/odom", 50.0, odometry)
    source = started(topics={"wheels": "/odom"})
    places = [frame.payload.pose_start_base.y for frame in itertools.islice(source.frames(), 10)]

    assert max(map(abs, places)) < 1e-9
    assert source.counters()["skipped.wheels"] > 5
    assert caplog.text.count("its frame is ") == 1


def test_a_driver_that_is_started_again_in_another_frame_goes_on(
    robot, new_robot, messages, started, caplog, wait_for
) -> None:
    robot.repeat("/odom", 50.0, lambda k: messages.odometry(0.01 * k))
    source = started(topics={"wheels": "/odom"})
    frames = source.frames()
    before = next(frames).payload.pose_start_base.x
    robot.die()

    def combined(k):
        message = messages.odometry(5.0 + 0.01 * k)
        message.header.frame_id = "odom_combined"
        return message

    new_robot(robot.domain).repeat("/odom", 50.0, combined)
    wait_for(lambda: next(frames) and source.counters().get("frame_changes.wheels"))

    assert 0.0 <= next(frames).payload.pose_start_base.x - before < 3.0  # from where it was
    assert source.counters()["restarts.wheels"] == 1
    assert not source.counters().get("skipped.wheels")
    assert "('odom_combined', 'base_link') now, and were of ('odom', 'base_link')" in caplog.text


def test_one_wrong_first_frame_costs_four_messages(messages) -> None:
    names, refused = FrameNames(), 0
    for k in range(7):
        try:
            names.note_message(messages.image(GREY, "mono8", frame_id="front_optical" if k else "camera"), 1)
        except SourceError:
            refused += 1

    assert (names.frame_id, refused) == ("front_optical", 4)


@pytest.mark.parametrize("w", [0.0, 1e-200])
def test_a_quaternion_of_no_length_is_no_orientation(messages, w: float) -> None:
    pose = messages.pose()
    pose.orientation.w = w

    with pytest.raises(ValueError, match="its sender does not know it"):
        planar_pose(pose)


@pytest.mark.parametrize(("first", "last", "step"), [(-1.0, 1.0, -0.5), (1.0, -1.0, 0.5), (-1.0, 1.0, 0.0)])
def test_a_scan_whose_steps_do_not_lead_to_its_end_is_refused(first, last, step) -> None:
    """It would be mirrored: walls on the left are seen on the right."""
    fields = {"angle_min": first, "angle_max": last, "angle_increment": step, "range_max": 10.0}
    message = new_message("sensor_msgs/msg/LaserScan", {**fields, "ranges": np.ones(5, np.float32)})

    with pytest.raises(ValueError, match="which side is left"):
        scan(message)


@pytest.mark.parametrize(
    ("first", "last", "step", "n"),
    [
        (2.0, -2.0, 0.010014, 229),
        (math.pi, -math.pi, math.radians(1), 360),
        (0.0, -0.0174533, math.radians(1), 360),
        (-2.0, 2.0, -0.010014, 229),
    ],
)
def test_a_scan_whose_end_is_wrapped_is_read(first, last, step, n) -> None:
    fields = {"angle_min": first, "angle_max": last, "angle_increment": step, "range_max": 10.0}
    message = new_message("sensor_msgs/msg/LaserScan", {**fields, "ranges": np.ones(n, np.float32)})

    assert scan(message).angle_step_rad == pytest.approx(step)


def test_a_scan_that_is_told_clockwise_is_read_so() -> None:
    fields = {"angle_min": 1.0, "angle_max": -1.0, "angle_increment": -0.5, "range_max": 10.0}
    message = new_message("sensor_msgs/msg/LaserScan", {**fields, "ranges": np.ones(5, np.float32)})

    np.testing.assert_allclose(scan(message).angles(), [1.0, 0.5, 0.0, -0.5, -1.0])


def test_a_driver_that_is_started_again_after_a_turn_goes_on_where_the_robot_was(messages) -> None:
    reader = new_reader("nav_msgs/msg/Odometry", TopicOptions(topic="/odom"))
    headings = [(1.0, 1), (1.05, 1), (0.0, 2), (0.1, 2)]  # it has turned on the spot, and begins at 0 again

    told = [reader.payload(messages.odometry(0.0, 0.0, theta), 0.0, writer) for theta, writer in headings]

    assert [odometry.pose_start_base.theta for odometry in told] == pytest.approx([0.0, 0.05, 0.05, 0.15])
    assert reader.restarts == 1
