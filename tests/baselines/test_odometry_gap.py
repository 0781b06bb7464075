"""Odometry that has no reading for seconds, and a pose that was restated behind the gap."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Belief, Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.frames import Frame, Odometry
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark_baselines.config import OdometryConfig
from trailmark_baselines.odometry import OdometryLocalizer

from .test_odometry import at, localizer, observed, sigmas


def test_a_step_across_a_gap_is_as_uncertain_as_a_robot_that_nobody_watched() -> None:
    usual, across = observed(localizer(), at(0.0, Pose2()), at(0.1, Pose2(0.05)), at(3.3, Pose2(0.06)))

    assert sigmas(usual).max() < 0.02
    np.testing.assert_allclose(sigmas(across)[:2], 1.6, rtol=0.01)  # 3.2 s at 0.5 m/s
    assert sigmas(across)[2] == pytest.approx(math.radians(96.0), rel=0.01)


def test_a_distance_across_a_gap_is_uncertain_too() -> None:
    (across,) = observed(localizer(), at(0.0, distance_m=0.0), at(4.0, distance_m=1.0))
    (along,) = observed(localizer(unmeasured_turn_deg=None), at(0.0, distance_m=0.0), at(4.0, distance_m=1.0))

    assert sigmas(across)[0] == pytest.approx(2.0, rel=0.01)
    assert along.information[0, 0] == pytest.approx(0.25, rel=0.01)


def test_a_heartbeat_is_no_gap() -> None:
    """Robots that log a reading a second while nothing changes."""
    beats = observed(localizer(), *[at(float(i), Pose2(0.1 * i)) for i in range(4)])

    assert all(sigmas(motion).max() < 0.05 for motion in beats)


def test_fixes_after_a_gap_in_which_the_robot_turned_are_believed() -> None:
    """The robot turns by 85 deg while no odometry comes; the next pose is restated as if it had turned by 4."""
    kalman = Kalman(KalmanConfig())
    kalman.start(Session(start_pose=Pose2()))
    made = OdometryLocalizer(OdometryConfig(wheels="wheels"))
    made.start(Session())
    poses = [*((0.1 * i, Pose2(0.05 * i)) for i in range(21)), (5.2, Pose2(1.0, 0.0, math.radians(-4.0)))]
    for stamp_s, pose in poses:
        for motion in made.observe(Frame("wheels", stamp_s, Odometry(pose)), Belief(stamp_s)):
            assert isinstance(motion, Motion)
            kalman.apply("wheels", motion)
    truth = Pose2(1.0, 0.0, math.radians(85.0))

    statuses = [
        kalman.apply("laser", Fix(5.2, truth, information_from_sigmas(0.02, 0.02, 0.01 * (1 + k)))).status
        for k in range(2)
    ]

    belief = kalman.belief(5.2).pose_map_base
    assert belief is not None
    assert statuses == ["accepted", "accepted"]
    assert abs(belief.theta - truth.theta) < 0.02
