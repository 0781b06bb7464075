"""Dead reckoning without corrections: what motion adds up to, gaps, overlaps, and how certain it is."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import (
    Fix,
    Motion,
    information_from_sigmas,
)
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Session

from .conftest import GOOD, ORIGIN, dead_reckoning, drive, motion, pose_of


class TestMotion:
    def test_motions_are_chained(self) -> None:
        estimator = dead_reckoning(Pose2(1.0, 2.0, math.pi / 2))
        estimator.apply("vo", motion(0.0, 1.0, 1.0, 0.0, math.pi / 2))
        estimator.apply("vo", motion(1.0, 2.0, 0.5))

        belief = estimator.belief()

        assert belief.stamp_s == 2.0
        np.testing.assert_allclose(pose_of(belief).array()[:2], [0.5, 3.0], atol=1e-15)
        np.testing.assert_allclose(belief.pose_odom_base.array()[:2], [1.0, 0.5], atol=1e-15)
        assert wrap_angle(pose_of(belief).theta - math.pi) == pytest.approx(0.0, abs=1e-15)

    def test_before_anything_base_stands_at_the_start(self) -> None:
        belief = dead_reckoning(Pose2(1.0, 2.0, 0.3)).belief()

        assert belief.pose_map_base == Pose2(1.0, 2.0, 0.3)
        assert belief.travelled_m == 0.0
        assert belief.motion_age_s == math.inf
        assert belief.fix_age_m == math.inf

    def test_the_belief_is_interpolated_along_the_arc(self) -> None:
        estimator = dead_reckoning()
        arc = Pose2.exp(1.0, 0.0, 1.0)
        estimator.apply("vo", Motion(0.0, 1.0, arc, GOOD))

        belief = estimator.belief(0.25)

        np.testing.assert_allclose(pose_of(belief).array(), Pose2.exp(0.25, 0.0, 0.25).array(), atol=1e-15)
        assert belief.travelled_m == pytest.approx(0.25)
        assert belief.motion_age_s == 0.0

    def test_the_belief_is_carried_on_with_the_last_twist(self) -> None:
        estimator = dead_reckoning()
        estimator.apply("vo", motion(0.0, 0.5, 0.5))

        belief = estimator.belief(0.8)

        assert pose_of(belief).x == pytest.approx(0.8)
        assert belief.travelled_m == pytest.approx(0.8)
        assert belief.motion_age_s == pytest.approx(0.3)
        assert belief.twist.forward_mps == pytest.approx(1.0)

    def test_the_twist_is_that_of_the_motion_at_the_stamp(self) -> None:
        estimator = dead_reckoning()
        estimator.apply("vo", motion(0.0, 1.0, 1.0))
        estimator.apply("vo", motion(1.0, 2.0, 3.0, 0.0, 0.2))

        assert estimator.belief(0.5).twist.forward_mps == pytest.approx(1.0)
        assert estimator.belief(1.5).twist.yaw_radps == pytest.approx(0.2)

    def test_a_gap_is_bridged_with_the_last_twist_and_counted(self) -> None:
        estimator = dead_reckoning()
        estimator.apply("vo", motion(0.0, 1.0, 1.0))
        estimator.apply("vo", motion(3.0, 4.0, 1.0))

        assert pose_of(estimator.belief(4.0)).x == pytest.approx(4.0)
        assert estimator.belief(2.5).motion_age_s == pytest.approx(1.5)
        assert estimator.belief(3.5).motion_age_s == 0.0
        assert estimator.counters() == {"gaps": 1, "overlaps": 0}

    def test_a_gap_makes_the_belief_less_certain(self) -> None:
        with_gap, without = dead_reckoning(), dead_reckoning()
        for estimator, since_s in ((with_gap, 2.0), (without, 1.0)):
            estimator.apply("vo", motion(0.0, 1.0, 1.0))
            estimator.apply("vo", motion(since_s, 3.0, 3.0 - since_s))

        covariances = [estimator.belief().covariance for estimator in (with_gap, without)]

        assert covariances[0] is not None
        assert covariances[1] is not None
        assert np.linalg.eigvalsh(covariances[0] - covariances[1])[0] > -1e-12
        assert covariances[0][0, 0] == pytest.approx(0.5**2, rel=0.1)  # 1 s at the drift's 0.5 m/s

    def test_an_overlap_counts_once(self) -> None:
        estimator = dead_reckoning()
        estimator.apply("vo", motion(0.0, 1.0, 1.0))
        estimator.apply("vo", motion(0.5, 1.5, 1.0))  # the first half is known

        assert pose_of(estimator.belief()).x == pytest.approx(1.5)
        assert estimator.counters()["overlaps"] == 1

    def test_a_motion_that_adds_nothing_is_refused(self) -> None:
        estimator = dead_reckoning()
        estimator.apply("vo", motion(0.0, 1.0, 1.0))

        applied = estimator.apply("klt", motion(0.2, 1.0, 0.8))

        assert applied.status == "refused"
        assert "already known until 1.000000 s" in applied.reason
        assert pose_of(estimator.belief()).x == 1.0

    def test_driving_backwards_is_way_too(self) -> None:
        estimator = dead_reckoning()
        estimator.apply("vo", motion(0.0, 1.0, 1.0))
        estimator.apply("vo", motion(1.0, 2.0, -1.0))

        assert estimator.belief().travelled_m == pytest.approx(2.0)

    def test_stamps_that_went_through_decimals_leave_no_gap(self) -> None:
        estimator = dead_reckoning()
        estimator.apply("vo", motion(0.0, 1 / 3, 1.0))
        estimator.apply("vo", motion(0.3333333, 1.0, 1.0))

        assert estimator.counters() == {"gaps": 0, "overlaps": 0}


class TestCovariance:
    def test_it_is_the_first_order_propagation(self) -> None:
        rng = np.random.default_rng(5)
        estimator = dead_reckoning(Pose2(40.0, -30.0, 2.0))
        expected = np.diag([0.01, 0.01, math.radians(0.5)]) ** 2
        pose = Pose2(40.0, -30.0, 2.0)
        for i in range(200):
            step, sigmas = Pose2(*rng.normal([0.05, 0.0, 0.0], [0.01, 0.01, 0.1])), rng.uniform(1e-3, 5e-3, 3)
            estimator.apply("vo", Motion(i / 10, (i + 1) / 10, step, information_from_sigmas(*sigmas)))
            after = pose @ step
            before_jacobian = np.array([[1, 0, pose.y - after.y], [0, 1, after.x - pose.x], [0, 0, 1]])
            cos, sin = math.cos(pose.theta), math.sin(pose.theta)
            step_jacobian = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
            expected = before_jacobian @ expected @ before_jacobian.T
            expected += step_jacobian @ np.diag(sigmas**2) @ step_jacobian.T
            pose = after

        np.testing.assert_allclose(estimator.belief().covariance, expected, rtol=1e-9, atol=1e-15)

    def test_after_a_fix_it_grows_from_the_fixs(self) -> None:
        late, fresh = dead_reckoning(), dead_reckoning(None)
        for estimator in (late, fresh):
            drive(estimator, 100)
            estimator.apply("map", Fix(50 / 70, Pose2(1.0, 2.0, 0.7), information_from_sigmas(0.01, 0.02, 0.03)))

        np.testing.assert_allclose(late.belief().covariance, fresh.belief().covariance, atol=1e-15)
        assert np.linalg.eigvalsh(late.belief().covariance - late.belief(50 / 70).covariance)[-1] > 0

    def test_it_grows_ahead_of_the_newest_motion(self) -> None:
        estimator = dead_reckoning()
        drive(estimator, 10)
        now_s = estimator.belief().stamp_s

        covariance = estimator.belief(now_s + 1.0).covariance

        assert covariance is not None
        assert covariance[2, 2] == pytest.approx(math.radians(30.0) ** 2, rel=0.01)


@pytest.mark.parametrize("start_pose", [ORIGIN, None], ids=["known", "unknown"])
@pytest.mark.parametrize("stamp_s", [0.0, 0.3, 0.71, 1.0, 1.5])  # forgotten, kept, between two frames, newest, ahead
def test_the_poses_alone_are_those_of_the_belief(start_pose: Pose2 | None, stamp_s: float) -> None:
    estimator = dead_reckoning(start_pose, history_s=0.5)
    drive(estimator, 70)

    told_s, pose_map_base, pose_odom_base = estimator.poses_at(stamp_s)

    belief = estimator.belief(stamp_s)
    assert (told_s, pose_map_base, pose_odom_base) == (belief.stamp_s, belief.pose_map_base, belief.pose_odom_base)


def test_one_that_is_asked_for_poses_alone_gives_the_same_ones() -> None:
    whole, poses = (DeadReckoning(DeadReckoningConfig(), poses_alone=alone) for alone in (False, True))
    for estimator in (whole, poses):
        estimator.start(Session(start_pose=ORIGIN))
        drive(estimator, 40)
        estimator.apply("map", Fix(20 / 70, Pose2(1.0, 2.0, 0.7), information_from_sigmas(math.inf, 0.02, 0.03)))

    assert poses.poses_at(0.6) == whole.poses_at(0.6)
    assert poses.poses_at(0.3) == whole.poses_at(0.3)
