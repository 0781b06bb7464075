"""Wheel odometry as a localizer."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from trailmark.estimates import Belief, Lost, Motion
from trailmark.frames import Frame, Odometry, Scalar
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import Session
from trailmark_baselines.config import OdometryConfig
from trailmark_baselines.odometry import OdometryLocalizer


def localizer(**keys) -> OdometryLocalizer:
    made = OdometryLocalizer(OdometryConfig.model_validate({"wheels": "wheels", **keys}))
    made.start(Session())
    return made


def at(stamp_s: float, pose: Pose2 | None = None, distance_m: float | None = None) -> Frame:
    return Frame("wheels", stamp_s, Odometry(pose, distance_m))


def observed(made: OdometryLocalizer, *frames: Frame) -> list:
    return [estimate for frame in frames for estimate in made.observe(frame, Belief(frame.stamp_s))]


def sigmas(motion: Motion) -> np.ndarray:
    return np.sqrt(np.diag(np.linalg.inv(motion.information)))


def test_the_first_frame_is_only_where_it_begins():
    assert observed(localizer(), at(1.0, Pose2(5, 5, 1))) == []


@given(st.floats(-3, 3), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-1, 1))
def test_motion_is_the_step_as_seen_from_where_it_began(heading, forward, left, turn):
    start = Pose2(7.0, -3.0, heading)
    step = Pose2(forward, left, turn)

    (motion,) = observed(localizer(), at(1.0, start), at(1.5, start @ step))

    assert (motion.since_s, motion.stamp_s) == (1.0, 1.5)
    np.testing.assert_allclose(motion.pose_since_now.array(), step.array(), atol=1e-9)


def test_motions_follow_on_each_other_and_join_to_the_whole_way():
    frames = [at(0.1 * i, Pose2.exp(0.05 * i, 0.0, 0.02 * i)) for i in range(100)]

    motions = observed(localizer(), *frames)

    pose = Pose2()
    for previous, motion in pairwise(motions):
        assert previous.stamp_s == motion.since_s
    for motion in motions:
        pose = pose @ motion.pose_since_now
    np.testing.assert_allclose(pose.array(), frames[-1].payload.pose_start_base.array(), atol=1e-9)


def test_after_one_metre_the_spread_is_what_the_config_says():
    config = {
        "distance_sigma": 0.03,
        "lateral_sigma": 0.02,
        "turn_sigma_deg": 1.0,
        "rest_sigma": 1e-6,
        "rest_sigma_deg": 1e-6,
    }

    (motion,) = observed(localizer(**config), at(0.0, Pose2()), at(1.0, Pose2(1.0)))

    turn = math.radians(1.0)
    np.testing.assert_allclose(sigmas(motion), [0.03, math.sqrt(0.02**2 + turn**2 / 3), turn], rtol=1e-6)


def test_four_metres_spread_twice_as_much_as_one():
    keys = {"rest_sigma": 1e-6, "rest_sigma_deg": 1e-6}
    (one,) = observed(localizer(**keys), at(0.0, Pose2()), at(1.0, Pose2(1.0)))
    (four,) = observed(localizer(**keys), at(0.0, Pose2()), at(1.0, Pose2(-4.0)))

    assert sigmas(four)[0] == pytest.approx(2 * sigmas(one)[0], rel=1e-6)
    assert sigmas(four)[2] == pytest.approx(2 * sigmas(one)[2], rel=1e-6)


def test_a_turn_on_the_spot_spreads_the_heading():
    keys = {"turning_sigma_deg": 3.0, "rest_sigma_deg": 1e-6}

    (motion,) = observed(localizer(**keys), at(0.0, Pose2()), at(1.0, Pose2(0.0, 0.0, -1.0)))

    assert sigmas(motion)[2] == pytest.approx(math.radians(3.0), rel=1e-6)


def test_a_robot_at_rest_is_not_infinitely_certain():
    (motion,) = observed(localizer(rest_sigma=0.002, rest_sigma_deg=0.2), at(0.0, Pose2()), at(1.0, Pose2()))

    np.testing.assert_allclose(sigmas(motion), [0.002, 0.002, math.radians(0.2)])


def test_a_distance_goes_straight_and_leaves_turn_and_side_nearly_open():
    keys = {"distance_sigma": 0.02, "unmeasured_turn_deg": 30.0, "rest_sigma": 1e-6, "rest_sigma_deg": 1e-6}

    (motion,) = observed(localizer(**keys), at(0.0, None, 3.0), at(1.0, None, 4.0))

    assert motion.pose_since_now == Pose2(1.0)
    np.testing.assert_allclose(sigmas(motion)[[0, 2]], [0.02, math.radians(30)], rtol=1e-6)
    assert sigmas(motion)[1] > 0.2


def test_a_distance_may_say_nothing_of_turn_and_side():
    (motion,) = observed(localizer(unmeasured_turn_deg=None), at(0.0, None, 3.0), at(1.0, None, 2.0))

    assert motion.pose_since_now == Pose2(-1.0)
    assert motion.information[0, 0] > 0
    np.testing.assert_array_equal(motion.information[1:, :], 0.0)


def test_a_jump_is_a_restart_lost_once_and_begun_anew():
    made = localizer(max_speed_mps=2.0)

    lost, motion = observed(made, at(0.0, Pose2(9)), at(0.5, Pose2()), at(1.0, Pose2(0.5)))

    assert isinstance(lost, Lost)
    assert lost.reason == "a jump of 9 m in 0.5 s: restarted?"
    assert (motion.since_s, motion.pose_since_now) == (0.5, Pose2(0.5))


@pytest.mark.parametrize("turn_rad", [1.0, -2.5])
def test_a_turn_that_nobody_makes_is_a_restart_too(turn_rad):
    lost, motion = observed(localizer(), at(0.0, Pose2(theta=turn_rad)), at(0.02, Pose2()), at(0.04, Pose2(0.01)))

    assert isinstance(lost, Lost)
    assert (
        lost.reason == f"a turn of {math.degrees(abs(turn_rad)):.3g} deg in 0.02 s: restarted, or degrees for radians?"
    )
    assert (motion.since_s, motion.pose_since_now) == (0.02, Pose2(0.01))


def test_two_readings_that_come_at_once_are_no_restart():
    (motion,) = observed(localizer(), at(0.0, Pose2()), at(0.0001, Pose2(theta=0.2)))

    assert isinstance(motion, Motion)


def test_frames_with_nothing_in_common_are_lost():
    (lost,) = observed(localizer(), at(0.0, Pose2()), at(1.0, None, 2.0))

    assert lost.reason == "the odometry changed between pose and distance"


def test_started_again_it_has_forgotten_the_last_frame():
    made = localizer()
    observed(made, at(0.0, Pose2()))

    made.start(Session())

    assert observed(made, at(1.0, Pose2(1.0))) == []


def test_other_frames_are_not_looked_at():
    assert observed(localizer(), Frame("light", 1.0, Scalar(3.0))) == []


@pytest.mark.parametrize("key", ["distance_sigma", "rest_sigma", "max_speed_mps"])
def test_sigmas_must_be_positive(key):
    with pytest.raises(ValidationError, match=f"{key}\n.*greater than 0"):
        localizer(**{key: 0.0})


class TestVelocity:
    def moving(self, stamp_s: float, pose: Pose2, twist: Twist2 | None) -> Frame:
        return Frame("wheels", stamp_s, Odometry(pose, None, twist))

    def test_it_drives_the_mean_of_two_velocities_whatever_the_pose_says(self):
        first = self.moving(1.0, Pose2(), Twist2(1.0, 0.0, 0.2))
        second = self.moving(1.5, Pose2(9.0, 9.0, 2.0), Twist2(2.0, 0.0, 0.4))

        (motion,) = observed(localizer(reads="velocity"), first, second)

        expected = Pose2.exp(0.75, 0.0, 0.15)
        np.testing.assert_allclose(motion.pose_since_now.array(), expected.array(), atol=1e-12)

    def test_without_a_velocity_it_is_lost_and_says_so(self):
        (lost,) = observed(
            localizer(reads="velocity"), self.moving(1.0, Pose2(), None), self.moving(1.5, Pose2(0.1), None)
        )

        assert lost == Lost(1.5, "the odometry gives no velocity")
