"""Standing: wheels that do not turn beside a gyro whose bias is estimated, and who must not be believed to stand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Belief, Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.geometry import Pose2
from trailmark.interfaces import Session

_DT_S = 0.1
_BIAS_RADPS = math.radians(0.5)
#: Wheels of which little is known at rest, as those of recordings are.
_WHEELS = information_from_sigmas(0.004, 0.004, math.radians(0.8))
_GYRO = information_from_sigmas(math.inf, math.inf, math.radians(0.06))
_BIASED = {"gyro": {"errors": "gyro_bias"}}


def started(**keys: object) -> Kalman:
    kalman = Kalman(KalmanConfig.model_validate({"sources": _BIASED, "standstill": "use"} | keys))
    kalman.start(Session("estimator", start_pose=Pose2()))
    return kalman


def tell(kalman: Kalman, step: int, *, wheels: Pose2 = Pose2(), gyro_radps: float = _BIAS_RADPS) -> None:  # noqa: B008
    since_s, stamp_s = (step - 1) * _DT_S, step * _DT_S
    kalman.apply("wheels", Motion(since_s, stamp_s, wheels, _WHEELS))
    kalman.apply("gyro", Motion(since_s, stamp_s, Pose2(0.0, 0.0, gyro_radps * _DT_S), _GYRO))


def pose_of(belief: Belief) -> Pose2:
    assert belief.pose_map_base is not None
    return belief.pose_map_base


def sigma_of_heading(belief: Belief) -> float:
    assert belief.covariance is not None
    return math.sqrt(float(belief.covariance[2, 2]))


def test_a_robot_that_stands_learns_the_bias_of_its_gyro() -> None:
    kalman, without = started(), started(standstill="off")
    for step in range(1, 101):
        tell(kalman, step)
        tell(without, step)

    bias, sigma = kalman.common_errors()["gyro"]
    assert bias == pytest.approx(_BIAS_RADPS, abs=3.0 * sigma)
    assert math.degrees(sigma) < 0.1
    assert sigma < 0.5 * without.common_errors()["gyro"][1]
    assert sigma_of_heading(kalman.belief()) < 0.6 * sigma_of_heading(without.belief())


def test_what_was_learned_while_standing_helps_on_the_way() -> None:
    kalman = started()
    for step in range(1, 101):
        tell(kalman, step)
    for step in range(101, 201):
        tell(kalman, step, wheels=Pose2(0.05), gyro_radps=_BIAS_RADPS)

    assert abs(math.degrees(pose_of(kalman.belief()).theta)) < 0.5  # by its bias alone, 5 degrees


@pytest.mark.parametrize("mover", ["gyro", "camera", "fixes"])
def test_wheels_that_are_stuck_while_something_moves_hold_nothing(mover: str) -> None:
    kalman, without = started(), started(standstill="off")
    for step in range(1, 101):
        stamp_s = step * _DT_S
        for each in (kalman, without):
            tell(each, step, gyro_radps=_BIAS_RADPS + (0.2 if mover == "gyro" and step > 50 else 0.0))
            if mover == "camera":
                seen = information_from_sigmas(0.002, 0.002, 0.002)
                each.apply("camera", Motion(stamp_s - _DT_S, stamp_s, Pose2(0.02 if step > 50 else 0.0), seen))
            if mover == "fixes" and step % 2 == 0:
                away_m = 0.2 * max(0.0, stamp_s - 5.0)
                each.apply("fixes", Fix(stamp_s, Pose2(away_m), information_from_sigmas(0.05, 0.05, 0.05)))

    moved, expected = pose_of(kalman.belief()), pose_of(without.belief())
    if mover == "gyro":
        assert math.degrees(moved.theta) > 0.9 * math.degrees(expected.theta) > 25.0
    else:
        assert moved.x == pytest.approx(expected.x, abs=0.1)
        assert moved.x > 0.7


def test_a_robot_on_a_turntable_is_not_held_unless_the_config_asks_for_it() -> None:
    kalman = Kalman(KalmanConfig.model_validate({"sources": _BIASED}))
    kalman.start(Session("estimator", start_pose=Pose2()))
    turn_radps = math.radians(0.3)
    for step in range(1, 601):
        tell(kalman, step, gyro_radps=_BIAS_RADPS + (turn_radps if step > 300 else 0.0))

    belief = kalman.belief()
    assert abs(pose_of(belief).theta - 30.0 * turn_radps) < 4.0 * sigma_of_heading(belief)


def test_a_speed_sensor_that_counts_nothing_is_no_word_on_the_turn() -> None:
    """It stands for 5 s, then turns on the spot: a sensor that does not measure turn goes on counting nothing."""
    kalman, without = started(), started(standstill="off")
    speed = information_from_sigmas(0.001, 0.001, math.inf)
    for step in range(1, 201):
        since_s, stamp_s = (step - 1) * _DT_S, step * _DT_S
        turn = math.radians(0.5) * _DT_S if step > 50 else 0.0
        for each in (kalman, without):
            each.apply("speed", Motion(since_s, stamp_s, Pose2(), speed))
            each.apply("gyro", Motion(since_s, stamp_s, Pose2(0.0, 0.0, turn), _GYRO))

    assert math.degrees(pose_of(kalman.belief()).theta) > 7.0  # of 7.5
    assert kalman.common_errors() == without.common_errors()


def test_a_run_without_a_gyro_is_the_same_to_the_last_bit() -> None:
    rng = np.random.default_rng(7)
    kalman, without = started(sources={}), started(sources={}, standstill="off")
    for step in range(1, 101):
        forward_m = 0.0 if step % 40 < 20 else 0.05 + rng.normal(0.0, 0.001)
        for each in (kalman, without):
            each.apply("wheels", Motion((step - 1) * _DT_S, step * _DT_S, Pose2(forward_m), _WHEELS))

    one, other = kalman.belief(), without.belief()
    assert pose_of(one) == pose_of(other)
    np.testing.assert_array_equal(one.covariance, other.covariance)
