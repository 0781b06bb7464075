"""Where base was in the robot's own odometry, at the stamp of a belief."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from trailmark.geometry import Pose2
from trailmark_ros2.robot_odometry import RobotOdometry


def odometry_of(*stamps_and_places: tuple[float, float]) -> RobotOdometry:
    odometry = RobotOdometry()
    for stamp_s, x in stamps_and_places:
        odometry.add(message(stamp_s, x))
    return odometry


def message(stamp_s: float, x: float) -> SimpleNamespace:
    sec, nanosec = divmod(round(stamp_s * 1e9), 10**9)
    linear, angular = SimpleNamespace(x=0.0, y=0.0, z=0.0), SimpleNamespace(x=0.0, y=0.0, z=0.0)
    pose = SimpleNamespace(
        position=SimpleNamespace(x=x, y=0.0, z=0.0), orientation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
    )
    return SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec), frame_id="/odom"),
        twist=SimpleNamespace(twist=SimpleNamespace(linear=linear, angular=angular)),
        pose=SimpleNamespace(pose=pose),
    )


def test_between_two_messages_it_is_interpolated() -> None:
    pose = odometry_of((1.0, 0.0), (2.0, 1.0)).pose_odom_base(1.25)

    assert pose is not None
    assert pose.x == pytest.approx(0.25)


def test_a_reading_that_is_sent_again_costs_no_history() -> None:
    pose = odometry_of((1.0, 0.0), (2.0, 1.0), (2.0, 1.0)).pose_odom_base(1.25)

    assert pose is not None
    assert pose.x == pytest.approx(0.25)


def test_a_driver_that_begins_anew_begins_a_new_history() -> None:
    odometry = odometry_of((100.0, 7.0), (101.0, 8.0), (1.0, 0.0))

    assert odometry.pose_odom_base(100.5) is None
    assert odometry.pose_odom_base(1.0) == Pose2(0.0, 0.0, 0.0)


def test_a_velocity_that_is_no_number_predicts_nothing() -> None:
    odometry = RobotOdometry()
    first, second = message(1.0, 0.0), message(2.0, 1.0)
    second.twist.twist.linear.x = float("nan")  # drivers say so that they do not know it
    odometry.add(first)
    odometry.add(second)

    assert odometry.pose_odom_base(2.0) == Pose2(1.0, 0.0, 0.0)
    assert odometry.pose_odom_base(1.5) == Pose2(0.5, 0.0, 0.0)
    assert odometry.pose_odom_base(2.05) is None
