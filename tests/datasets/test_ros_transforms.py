"""Mountings from /tf_static, and odometry from a transform that moves."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.errors import SourceError
from trailmark.frames import SensorOrigin
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import Session
from trailmark_datasets.config import RosbagConfig
from trailmark_datasets.rosbag import Rosbag

GREY = np.zeros((3, 4), np.uint8)
#: Optical axes (x right, y down, z forward) in the axes of a sensor that looks ahead, as an URDF says it.
OPTICAL = Pose3(roll=-math.pi / 2, yaw=-math.pi / 2)
AHEAD = Pose3(0.3, 0.1, 0.5, yaw=math.radians(30))


def bag(path, **keys) -> Rosbag:
    return Rosbag(RosbagConfig.model_validate({"path": path, **keys}))


def started(source: Rosbag) -> Rosbag:
    source.start(Session())
    return source


def mounting_of(source: Rosbag, sensor: str) -> list[float]:
    pose = source.sensors[sensor].pose_base_sensor
    return [pose.x, pose.y, pose.z, pose.roll, pose.pitch, pose.yaw]


def camera_and_laser(record, base: str = "base_link"):
    """A camera ahead on a mast that stands on base, and a laser that looks back."""
    record.add("/tf_static", record.mounting(base, "mast", Pose3(x=-0.2, z=1.0)), 0.5)
    record.add("/tf_static", record.mounting("mast", "camera_link", AHEAD), 0.5)
    record.add("/tf_static", record.mounting("camera_link", "camera_optical", OPTICAL), 0.5)
    record.add("/tf_static", record.mounting(f"/{base}", "laser", Pose3(0.1, 0.0, 0.2, yaw=math.pi / 2)), 0.5)
    record.add("/cam/image_raw", record.image(1.0, GREY, "mono8", frame_id="camera_optical"), 1.0)
    record.add("/cam/camera_info", record.info(500.0), 1.0)
    record.add("/scan", record.scan(1.0, [1.0, 1.0], frame_id="/laser"), 1.0)
    return record


@pytest.mark.parametrize("kind", ["ros1", "sqlite", "mcap"])
def test_static_transforms_say_where_sensors_are_mounted(tmp_path, recording, kind):
    source = started(bag(camera_and_laser(recording(kind)).write(tmp_path)))

    np.testing.assert_allclose(mounting_of(source, "cam_image_raw"), [0.1, 0.1, 1.5, 0, 0, math.pi / 6], atol=1e-9)
    np.testing.assert_allclose(mounting_of(source, "scan"), [0.1, 0, 0.2, 0, 0, math.pi / 2], atol=1e-9)
    assert source.origins()["cam_image_raw"] == SensorOrigin(
        "/tf_static (base_link -> camera_optical: x: 0.1, y: 0.1, z: 1.5, yaw_deg: 30)", "/cam/camera_info"
    )


def test_a_camera_that_looks_down_is_pitched(tmp_path, recording):
    """The optical axis points down, so that the sensor's own x axis does: pitch is 90 deg."""
    record = recording()
    record.add("/tf_static", record.mounting("base_link", "down_optical", Pose3(z=0.4, roll=math.pi)), 0.5)
    record.add("/down", record.image(1.0, GREY, "mono8", frame_id="down_optical"), 1.0)

    pose = started(bag(record.write(tmp_path))).sensors["down"].pose_base_sensor

    np.testing.assert_allclose(pose.rotation() @ [1, 0, 0], [0, 0, -1], atol=1e-9)
    assert pose.z == pytest.approx(0.4)


def test_a_picture_in_a_link_has_the_axes_of_the_link(tmp_path, recording):
    record = recording()
    record.add("/tf_static", record.mounting("base_link", "camera_link", AHEAD), 0.5)
    record.add("/cam", record.image(1.0, GREY, "mono8", frame_id="camera_link"), 1.0)

    source = started(bag(record.write(tmp_path)))

    np.testing.assert_allclose(mounting_of(source, "cam"), [0.3, 0.1, 0.5, 0, 0, math.pi / 6], atol=1e-9)


def test_base_may_have_another_name(tmp_path, recording, caplog):
    path = camera_and_laser(recording(), base="chassis").write(tmp_path)

    unknown = started(bag(path))
    named = started(bag(path, base_frame="/chassis"))

    assert mounting_of(unknown, "scan") == [0.0] * 6
    assert "is called base_link, so no mounting is taken" in caplog.text
    assert "chassis" in caplog.text
    assert mounting_of(named, "scan")[0] == pytest.approx(0.1)


def test_a_base_that_is_not_there_is_refused_naming_the_frames(tmp_path, recording):
    path = camera_and_laser(recording()).write(tmp_path)

    with pytest.raises(SourceError, match=r"base_frame 'base_lnk' is not in /tf_static \(did you mean 'base_link'\?\)"):
        started(bag(path, base_frame="base_lnk"))


def test_mountings_may_be_left_alone(tmp_path, recording):
    source = started(bag(camera_and_laser(recording()).write(tmp_path), tf_static=False))

    assert mounting_of(source, "scan") == [0.0] * 6
    assert source.origins()["cam_image_raw"] == SensorOrigin("", "/cam/camera_info")


def test_a_sensor_that_nothing_leads_to_is_said(tmp_path, recording, caplog):
    record = recording()
    record.add("/tf_static", record.mounting("base_link", "other", AHEAD), 0.5)
    record.add("/scan", record.scan(1.0, [1.0], frame_id="laser"), 1.0)

    source = started(bag(record.write(tmp_path)))

    assert mounting_of(source, "scan") == [0.0] * 6
    assert "nothing in /tf_static leads from base_link to 'laser'" in caplog.text


def test_a_circle_of_frames_ends(tmp_path, recording):
    record = recording()
    record.add("/tf_static", record.mounting("base_link", "a", AHEAD), 0.5)
    record.add("/tf_static", record.mounting("laser", "b", AHEAD), 0.5)
    record.add("/tf_static", record.mounting("b", "laser", AHEAD), 0.5)
    record.add("/scan", record.scan(1.0, [1.0], frame_id="laser"), 1.0)

    assert mounting_of(started(bag(record.write(tmp_path))), "scan") == [0.0] * 6


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("quat_xyzw", [(0, 0, 0, 0), (0, 0, 0, math.nan), (0, 0, 0, math.inf)])
def test_a_mounting_without_an_orientation_is_refused_where_it_matters(tmp_path, recording, quat_xyzw):
    record = recording()
    record.add("/tf_static", record.mounting("base_link", "laser", AHEAD, quat_xyzw), 0.5)
    record.add("/scan", record.scan(1.0, [1.0], frame_id="laser"), 1.0)
    record.add("/odom", record.odometry(1.0, 0, 0, 0), 1.0)
    path = record.write(tmp_path)

    with pytest.raises(SourceError, match="laser a quaternion that is zero or not finite; set tf_static: false"):
        started(bag(path, topics={"laser": "/scan"}))
    assert list(started(bag(path, topics={"wheels": "/odom"})).sensors) == ["wheels"]


def test_a_laser_upside_down_is_said(tmp_path, recording, caplog):
    record = recording()
    record.add("/tf_static", record.mounting("base_link", "laser", Pose3(roll=math.pi)), 0.5)
    record.add("/scan", record.scan(1.0, [1.0], frame_id="laser"), 1.0)

    started(bag(record.write(tmp_path)))

    assert "the laser of /scan is not level (roll_deg: 180)" in caplog.text


@pytest.mark.parametrize("kind", ["ros1", "sqlite"])
def test_a_transform_that_moves_is_odometry_where_it_is_asked_for(tmp_path, recording, play, kind):
    record = recording(kind)
    for index in range(3):
        stamp_s = 1.0 + index
        record.add("/tf", record.transform(stamp_s, "odom", "base_link", 5.0 + 2.0 * index, 0.0), stamp_s)
        record.add("/tf", record.transform(stamp_s, "map", "odom", 99.0, 1.0), stamp_s)
        record.add("/scan", record.scan(stamp_s, [1.0]), stamp_s)
    path = record.write(tmp_path)

    frames = play(bag(path, topics={"wheels": "odom -> base_link"}))

    assert [frame.payload.pose_start_base for frame in frames] == [Pose2(), Pose2(2.0), Pose2(4.0)]
    assert [frame.stamp_s for frame in frames] == [1.0, 2.0, 3.0]
    assert {frame.sensor for frame in play(bag(path))} == {"scan"}  # not asked for


@pytest.mark.parametrize(
    ("topic", "message"),
    [
        ("odom -> base_footprint", "no transform 'odom -> base_footprint' in /tf; there are 'odom -> base_link'"),
        ("/scan -> x", "no transform 'scan -> x'"),
    ],
)
def test_a_transform_that_never_comes_is_refused_naming_those_that_do(tmp_path, recording, topic, message):
    record = recording()
    record.add("/tf", record.transform(1.0, "odom", "base_link", 0.0, 0.0), 1.0)

    with pytest.raises(SourceError, match=message):
        started(bag(record.write(tmp_path), topics={"wheels": topic}))


def test_a_recording_without_transforms_says_so(tmp_path, recording):
    record = recording()
    record.add("/scan", record.scan(1.0, [1.0]), 1.0)

    with pytest.raises(SourceError, match=r"no topic holds transforms that move \(/tf\)"):
        started(bag(record.write(tmp_path), topics={"wheels": "odom -> base_link"}))


def test_a_moving_transform_without_an_orientation_is_an_error_or_a_counted_skip(tmp_path, recording, play):
    record = recording()
    record.add("/tf", record.transform(1.0, "odom", "base_link", 0.0, 0.0), 1.0)
    empty = record.transform(2.0, "odom", "base_link", 0.0, 0.0)
    empty.transforms[0].transform.rotation.w = 0.0
    record.add("/tf", empty, 2.0)
    path, topics = record.write(tmp_path), {"wheels": "odom -> base_link"}

    with pytest.raises(SourceError, match=r"message 1 of /tf cannot be used: .*\(0, 0, 0, 0\)"):
        play(bag(path, topics=topics))
    assert len(play(bag(path, topics=topics, on_bad_frame="skip"))) == 1
