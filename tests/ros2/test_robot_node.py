"""A source behind topics: what it senses arrives unchanged, and commands move it."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="the extra [ros2] is not installed")

import trailmark
from trailmark.commands import Stop, Velocity
from trailmark.frames import Image, Imu, Odometry, Scalar, Scan
from trailmark.geometry import Pose2, Twist2, read_tum
from trailmark.interfaces import Session
from trailmark.sources import ros_messages
from trailmark_ros2 import dds
from trailmark_ros2.message_types import deserialize, new_message, serialize
from trailmark_ros2.robot_messages import reading_message, velocity_of_twist
from trailmark_ros2.robot_node import RobotNode
from trailmark_sim.config import SimConfig
from trailmark_sim.source import SimSource

TWIST = "geometry_msgs/msg/Twist"
ROBOT = {
    "plugin": "sim",
    "world": "ground_course",
    "route": "straight",
    "sensors": ["wheels"],
    "rates_hz": {"wheels": 20},
    "vehicle": {"kind": "differential"},
    "speed_mps": 0.3,
}
LOCAL = {
    "localizers": {"wheels": {"plugin": "odometry"}},
    "estimator": {"plugin": "kalman"},
    "controller": {"plugin": "path_tracking", "speed_mps": 0.3, "max_fix_age_m": None, "max_motion_age_s": None},
}


def through_cdr(message):
    return deserialize(serialize(message), message.__msgtype__)


@pytest.mark.parametrize("shape", [(4, 6), (4, 6, 3)])
def test_pictures_arrive_as_they_were(shape) -> None:
    pixels = np.random.default_rng(7).integers(0, 255, shape).astype(np.uint8)

    message = through_cdr(reading_message(Image(pixels), 12.5, "floor"))

    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id) == (12, 500000000, "floor")
    np.testing.assert_array_equal(ros_messages.image(message, "/floor").pixels, pixels)


def test_odometry_arrives_as_it_was() -> None:
    told = Odometry(Pose2(1.0, -2.0, 0.7), twist=Twist2(0.3, 0.0, -0.1))

    heard = ros_messages.odometry(through_cdr(reading_message(told, 1.0, "wheels")), Pose2())

    assert heard.pose_start_base is not None
    np.testing.assert_allclose(heard.pose_start_base.array(), [1.0, -2.0, 0.7], atol=1e-12)
    assert heard.twist == told.twist


def test_scans_and_inertial_readings_arrive_as_they_were() -> None:
    ranges_m = np.array([1.0, np.nan, 3.0], np.float32)
    scan = ros_messages.scan(through_cdr(reading_message(Scan(ranges_m, -0.5, 0.25, 0.1, 9.0), 1.0, "laser")))
    imu = ros_messages.imu(through_cdr(reading_message(Imu(np.array([0.1, 0.2, 0.3])), 1.0, "imu")))

    np.testing.assert_array_equal(scan.ranges_m, ranges_m)
    assert (scan.angle_min_rad, scan.angle_step_rad) == (-0.5, 0.25)
    np.testing.assert_array_equal(imu.angular_velocity_radps, [0.1, 0.2, 0.3])
    assert imu.linear_acceleration_mps2 is None
    assert imu.quat_xyzw is None


def test_what_has_no_message_is_not_sent() -> None:
    assert reading_message(Scalar(1.0), 1.0, "light") is None


@pytest.mark.parametrize(
    ("x", "yaw", "command"),
    [(0.3, 0.1, Velocity(0.3, 0.0, 0.1)), (0.0, 0.0, Stop("zero velocity")), (math.nan, 0.0, Stop("zero velocity"))],
)
def test_twists_are_velocities_and_no_numbers_are_a_stop(x, yaw, command) -> None:
    vector = "geometry_msgs/msg/Vector3"
    fields = {"linear": new_message(vector, {"x": x}), "angular": new_message(vector, {"z": yaw})}

    assert velocity_of_twist(new_message(TWIST, fields)) == command


def simulated(mode, **keys) -> SimSource:
    given = {key: value for key, value in ROBOT.items() if key != "plugin"} | keys
    source = SimSource(SimConfig.model_validate(given))
    source.start(Session(mode=mode))
    return source


def test_nobody_who_reads_is_said(domain) -> None:
    source = simulated("teach")
    network = dds.Network(domain)

    node = RobotNode(network, source, command="/cmd_vel")

    assert node.topics == {"wheels": "/wheels/odom"}
    assert not node.run(wait_s=0.2)
    network.close()


def test_commands_that_cease_stop_it(domain, robot, wait_for) -> None:
    source = simulated("replay", duration_s=3)
    network = dds.Network(domain)
    reader = robot.hear("/wheels/odom", "nav_msgs/msg/Odometry")
    node = RobotNode(network, source, command="/cmd_vel", pace=2.0)
    ahead = new_message(TWIST, {"linear": new_message("geometry_msgs/msg/Vector3", {"x": 0.3})})
    commands = robot.network.publisher("/cmd_vel", TWIST, dds.Quality())
    assert wait_for(lambda: commands.n_matched)
    commands.send(ahead)
    assert commands.wait_for_acknowledgments(5.0)

    assert node.run(wait_s=30.0, stand_s=0.1)

    way_m = source.ground_truth().poses[:, 0]
    assert 0.1 < way_m[-1] < 0.3  # half a second at 0.3 m/s, and rolling on; not three
    assert way_m[-1] == pytest.approx(way_m[-10], abs=1e-3)
    assert reader.n_matched
    network.close()


@pytest.mark.slow
def test_a_simulated_robot_is_taught_and_driven_through_topics(domain, tmp_path: Path) -> None:
    """As `benchmarks/ros2_closed_loop.py`, by the wheels alone and no farther than a short way."""
    store = tmp_path / "path.trail"
    for mode, limit_s, start in (("teach", 3.0, [0.0, 0.0, 0.0]), ("replay", 60.0, "first")):
        config = tmp_path / f"{mode}.json"
        config.write_text(json.dumps({"sources": {"robot": ROBOT | {"duration_s": limit_s}}, **LOCAL}))
        line = [sys.executable, "-m", "trailmark.cli", "ros2", "robot", str(config), "--mode", mode]
        line += ["--domain", str(domain), "--truth", str(tmp_path / f"{mode}.tum")]
        robot = {"plugin": "ros2", "domain": domain, "topics": {"wheels": "/wheels/odom"}, "command": "/cmd_vel"}
        robot |= {"end_when_silent_s": 2.0, "watchdog_s": 2.0}  # the machine may be busy
        with subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as node:
            result = trailmark.run(
                {"sources": {"robot": robot}, **LOCAL, "start": start},
                tmp_path / mode, mode=mode, store=store, report=False,
            )  # fmt: skip
            if mode == "replay":
                node.terminate()
            node.wait(30.0)

    taught, driven = read_tum(tmp_path / "teach.tum").poses, read_tum(tmp_path / "replay.tum").poses
    assert result.reason == "the end of the path is reached"
    assert taught[-1, 0] > 0.6
    assert driven[-1, 0] == pytest.approx(taught[-1, 0], abs=0.1)
    assert np.abs(driven[:, 1]).max() < 0.02
