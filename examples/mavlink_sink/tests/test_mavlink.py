"""The sink against pymavlink's own reader, on loopback; frames against numbers worked by hand."""

from __future__ import annotations

import math
import socket
from collections.abc import Callable, Iterator

import numpy as np
import pytest

pytest.importorskip("pymavlink", reason="pymavlink is not installed")

from pymavlink.dialects.v20 import common as mavlink
from trailmark_mavlink.config import MavlinkSinkConfig
from trailmark_mavlink.frames import covariance_21, pose_frd, pose_ned
from trailmark_mavlink.sink import MavlinkSink

from trailmark.errors import ConfigError
from trailmark.estimates import Belief
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import Session
from trailmark.testing import parametrize_with_sink_checks

Hear = Callable[[], list]
BOTH = ("odometry", "vision_position_estimate")


@pytest.fixture
def autopilot() -> Iterator[tuple[int, Hear]]:
    """A port of an autopilot, and what returns the messages that have come."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as heard:
        heard.bind(("127.0.0.1", 0))
        heard.settimeout(0.2)
        reader = mavlink.MAVLink(None)

        def hear() -> list:
            messages = []
            while True:
                try:
                    messages += reader.parse_buffer(heard.recv(2000)) or []
                except TimeoutError:
                    return messages

        yield heard.getsockname()[1], hear


def started(port: int, **keys: object) -> MavlinkSink:
    sink = MavlinkSink(MavlinkSinkConfig.model_validate({"port": port} | keys))
    sink.start(Session())
    return sink


@parametrize_with_sink_checks(MavlinkSink, config=MavlinkSinkConfig(messages=BOTH))
def test_the_contract(check: Callable[[], None]) -> None:
    check()


def test_odometry_is_forward_right_down(autopilot: tuple[int, Hear]) -> None:
    port, hear = autopilot
    covariance = np.array([[0.04, 0.01, 0.002], [0.01, 0.09, -0.003], [0.002, -0.003, 0.01]])

    # 3 m ahead, 2 m to the left, turned to the left by 30 deg, sliding to the left
    belief = Belief(12.5, Pose2(3.0, 2.0, math.radians(30.0)), covariance, twist=Twist2(0.5, 0.1, 0.2))
    started(port).on_belief(belief)
    (message,) = hear()

    assert message.get_type() == "ODOMETRY"
    assert (message.get_srcSystem(), message.get_srcComponent()) == (1, mavlink.MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY)
    assert (message.frame_id, message.child_frame_id) == (mavlink.MAV_FRAME_LOCAL_FRD, mavlink.MAV_FRAME_BODY_FRD)
    assert message.time_usec == 12_500_000
    assert (message.x, message.y, message.z) == (3.0, -2.0, 0.0)
    assert 2.0 * math.degrees(math.atan2(message.q[3], message.q[0])) == pytest.approx(-30.0, abs=1e-4)
    assert (message.vx, message.vy, message.yawspeed) == pytest.approx((0.5, -0.1, -0.2))
    upper = message.pose_covariance
    assert (upper[0], upper[6], upper[20]) == pytest.approx((0.04, 0.09, 0.01))  # x, y, yaw
    assert (upper[1], upper[5], upper[10]) == pytest.approx((-0.01, -0.002, -0.003))  # x-y, x-yaw, y-yaw


def test_vision_position_is_north_east_down(autopilot: tuple[int, Hear]) -> None:
    port, hear = autopilot

    # North is to the left of the map's x axis, which is east: a robot that looks along x looks east.
    started(port, messages=["vision_position_estimate"], north_deg=90.0).on_belief(Belief(1.0, Pose2(3.0, 2.0, 0.0)))
    (message,) = hear()

    assert message.get_type() == "VISION_POSITION_ESTIMATE"
    assert (message.x, message.y) == pytest.approx((2.0, 3.0))
    assert message.yaw == pytest.approx(math.pi / 2)
    assert math.isnan(message.covariance[0])  # not known


@pytest.mark.parametrize("north_rad", [0.0, 0.7, -2.0])
def test_a_covariance_turns_with_its_axes(north_rad: float) -> None:
    rng = np.random.default_rng(7)
    root = rng.normal(size=(3, 3)) * 0.01
    poses = [Pose2(1.0 + dx, 2.0 + dy, 0.3 + dt) for dx, dy, dt in rng.normal(size=(20000, 3)) @ root]
    mapped = np.array([pose_ned(pose, north_rad) for pose in poses])

    upper = covariance_21(root.T @ root, north_rad)
    full = np.zeros((6, 6))
    full[np.triu_indices(6)] = upper

    scatter = np.cov(mapped.T)
    upper_left = np.triu_indices(3)
    np.testing.assert_allclose(full[np.ix_((0, 1, 5), (0, 1, 5))][upper_left], scatter[upper_left], atol=1e-5)


def test_with_north_ahead_ned_is_frd() -> None:
    pose = Pose2(1.0, 2.0, 0.5)

    assert pose_ned(pose, 0.0) == pytest.approx(pose_frd(pose))


def test_a_robot_that_does_not_know_where_it_is_says_nothing(autopilot: tuple[int, Hear]) -> None:
    port, hear = autopilot
    sink = started(port)

    sink.on_belief(Belief(1.0, None))
    sink.on_belief(Belief(2.0, Pose2(), np.eye(3)))
    sink.on_belief(Belief(3.0, Pose2(), np.full((3, 3), np.nan)))

    assert hear() == []


def test_a_jump_is_told_and_driving_is_none(autopilot: tuple[int, Hear]) -> None:
    port, hear = autopilot
    sink = started(port, messages=BOTH)

    sink.on_belief(Belief(1.0, Pose2(1.0), pose_odom_base=Pose2(5.0)))
    sink.on_belief(Belief(2.0, Pose2(2.0), pose_odom_base=Pose2(6.0)))  # one metre, driven
    sink.on_belief(Belief(3.0, Pose2(2.5), pose_odom_base=Pose2(6.0)))  # half a metre, found

    assert [message.reset_counter for message in hear()] == [0, 0, 0, 0, 1, 1]


def test_no_more_is_sent_than_the_rate_says(autopilot: tuple[int, Hear]) -> None:
    port, hear = autopilot
    sink = started(port, rate_hz=10.0)

    for k in range(101):
        sink.on_belief(Belief(0.01 * k, Pose2()))

    assert len(hear()) == 11


def test_a_host_without_an_address_is_named() -> None:
    with pytest.raises(ConfigError, match=r"no\.such\.host\.invalid has no address"):
        started(14550, host="no.such.host.invalid")
