"""Absolute poses in recordings: as readings where they are named, and as the truth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.errors import SourceError
from trailmark.interfaces import Session
from trailmark.sources.ros_poses import LocalPlane
from trailmark_datasets.config import RosbagConfig
from trailmark_datasets.rosbag import Rosbag


def bag(path, **keys) -> Rosbag:
    return Rosbag(RosbagConfig.model_validate({"path": path, **keys}))


def started(source: Rosbag) -> Rosbag:
    source.start(Session())
    return source


def test_a_local_plane_has_the_scale_of_the_ellipsoid():
    """One degree at 45 N is 111.132 km along the meridian and 78.847 km along the parallel (WGS 84)."""
    plane = LocalPlane()
    plane.place(45.0, 7.0)

    x, y = plane.place(45.001, 7.001)

    assert (x, y) == pytest.approx((78.847, 111.132), rel=2e-5)


def test_a_plane_on_the_date_line_is_one_plane():
    plane = LocalPlane()
    plane.place(0.0, 179.9999)

    assert plane.place(0.0, -179.9999)[0] == pytest.approx(22.264, abs=1e-3)


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_poses_are_read_where_they_are_named(tmp_path, recording, play, kind):
    spread = np.diag([0.04, 0.09, 1.0, 1.0, 1.0, 0.01])
    record = recording(kind)
    record.add("/pose", record.pose(1.0, 1.0, 2.0, 0.5), 1.0)
    record.add("/amcl", record.pose(1.5, 3.0, 4.0, -0.5, spread), 1.5)
    record.add("/odom", record.odometry(2.0, 0.0, 0.0, 0.0), 2.0)
    path = record.write(tmp_path)

    frames = play(bag(path, topics={"tracker": "/pose", "amcl": "/amcl"}))

    np.testing.assert_allclose(frames[0].payload.arrays["pose"], [1.0, 2.0, 0.5])
    assert np.isnan(frames[0].payload.arrays["covariance"]).all()  # the message does not say
    np.testing.assert_allclose(frames[1].payload.arrays["covariance"], np.diag([0.04, 0.09, 0.01]))
    assert {frame.sensor for frame in play(bag(path))} == {"odom"}  # not named: left as it was


def test_a_receiver_without_a_fix_gives_no_reading(tmp_path, recording, play):
    record = recording("sqlite")
    record.add("/fix", record.satellites(1.0, 0.0, 0.0, status=-1), 1.0)
    record.add("/fix", record.satellites(2.0, 45.0, 7.0, sigma=1.5), 2.0)
    record.add("/fix", record.satellites(3.0, 45.001, 7.0, sigma=1.5), 3.0)
    source = bag(record.write(tmp_path), topics={"gps": "/fix"})

    frames = play(source)

    assert source.counters()["no_fix_gps"] == 1
    np.testing.assert_allclose([f.payload.arrays["pose"][1] for f in frames], [0.0, 111.132], atol=2e-3)
    np.testing.assert_allclose(frames[0].payload.arrays["covariance"], np.diag([2.25, 2.25, np.inf]))


@pytest.mark.parametrize("kind", ["mcap", "sqlite"])
def test_any_topic_of_poses_may_be_the_truth(tmp_path, recording, kind):
    record = recording(kind)
    for index in range(3):
        stamp_s = 1.0 + index
        record.add("/odom", record.odometry(stamp_s, 0.0, 0.0, 0.0), stamp_s)
        record.add("/pose", record.pose(stamp_s, 2.0 * index, 1.0, 0.1 * index), stamp_s)
        record.add("/tf", record.transform(stamp_s, "map", "base_link", 3.0 * index, 0.2), stamp_s)
        record.add("/tf", record.transform(stamp_s, "map", "other", 99.0, 0.0), stamp_s)
    path = record.write(tmp_path)

    for truth, expected in (("/pose", [4.0, 1.0, 0.2]), ("map -> base_link", [6.0, 0.0, 0.2]), ("/odom", [0, 0, 0])):
        trajectory = started(bag(path, ground_truth_topic=truth)).ground_truth()

        np.testing.assert_allclose(trajectory.stamps_s, [1.0, 2.0, 3.0])
        np.testing.assert_allclose(trajectory.poses[-1], expected, atol=1e-9)


def test_satellites_as_truth_head_along_their_way(tmp_path, recording):
    record = recording("sqlite")
    for index in range(5):
        record.add("/fix", record.satellites(1.0 + index, 45.0 + 1e-5 * index, 7.0), 1.0 + index)
    record.add("/odom", record.odometry(1.0, 0.0, 0.0, 0.0), 1.0)

    trajectory = started(bag(record.write(tmp_path), ground_truth_topic="/fix")).ground_truth()

    np.testing.assert_allclose(trajectory.poses[:, 2], math.pi / 2)
    np.testing.assert_allclose(trajectory.poses[:, 1], 1.11132 * np.arange(5), atol=1e-4)


@pytest.mark.parametrize(
    ("truth", "message"),
    [
        ("/pse", "ground_truth_topic '/pse' holds no poses; topics that do: /odom"),
        ("/scan", "holds no poses"),
        ("map -> base_link", "holds no poses"),
    ],
)
def test_a_truth_that_is_not_there_is_said_with_what_is(tmp_path, recording, truth, message):
    record = recording("ros1")
    record.add("/odom", record.odometry(1.0, 0.0, 0.0, 0.0), 1.0)
    record.add("/scan", record.scan(1.0, [1.0]), 1.0)
    source = started(bag(record.write(tmp_path), ground_truth_topic=truth))

    with pytest.raises(SourceError, match=message):
        source.ground_truth()


def test_topics_that_are_not_read_are_listed_with_what_to_do(tmp_path, recording):
    record = recording("sqlite")
    record.add("/odom", record.odometry(1.0, 0.0, 0.0, 0.0), 1.0)
    record.add("/fix", record.satellites(1.0, 45.0, 7.0), 1.0)
    record.add("/chatter", record.text("hello"), 1.0)

    assert started(bag(record.write(tmp_path))).unread() == {
        "/chatter": "std_msgs/msg/String: not understood",
        "/fix": "sensor_msgs/msg/NavSatFix: read when topics names it, or as ground_truth_topic",
    }
