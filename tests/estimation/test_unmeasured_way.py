"""A way that nobody measures: wide as time goes on, and named; as before where somebody measures it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Belief, Fix, Motion, information_from_sigmas
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.geometry import Pose2
from trailmark.interfaces import Estimator, Session

_SPEED_MPS, _DT_S = 0.5, 0.1
# Of walls without an end: the way along them is not seen.
_CORRIDOR = np.diag([0.0, 1e3**2, 1e3**2])


def _estimator(name: str) -> Estimator:
    estimator = Kalman(KalmanConfig()) if name == "kalman" else DeadReckoning(DeadReckoningConfig())
    estimator.start(Session(start_pose=Pose2()))
    return estimator


def _motion(index: int, step_m: float, information: np.ndarray) -> Motion:
    return Motion((index - 1) * _DT_S, index * _DT_S, Pose2(step_m), information)


def _sigmas_off(belief: Belief, x_m: float) -> float:
    assert belief.pose_map_base is not None
    assert belief.covariance is not None
    return abs(belief.pose_map_base.x - x_m) / math.sqrt(belief.covariance[0, 0])


def _drive_corridor(estimator: Estimator, since: int, until: int) -> None:
    for index in range(since, until):
        estimator.apply("scan", _motion(index, 0.0, _CORRIDOR))


@pytest.mark.parametrize("name", ["kalman", "dead_reckoning"])
def test_in_a_corridor_the_belief_covers_the_truth_and_says_why(name: str) -> None:
    """The laser sees a standing robot for a minute; it drives on at the speed that drift allows for."""
    estimator = _estimator(name)
    for index in range(1, 601):
        _drive_corridor(estimator, index, index + 1)
        belief = estimator.belief(index * _DT_S)
        assert _sigmas_off(belief, _SPEED_MPS * belief.stamp_s) < 3.0
    assert belief.covariance is not None
    assert math.sqrt(belief.covariance[0, 0]) < 2.0 * _SPEED_MPS * 60.0
    assert math.sqrt(belief.covariance[1, 1]) < 1.0
    assert belief.health["scan"] == "nothing measures the way along 0 deg of base, for 60.0 s"


@pytest.mark.parametrize("name", ["kalman", "dead_reckoning"])
def test_a_fix_says_where_base_is_and_the_way_is_unknown_from_there(name: str) -> None:
    estimator = _estimator(name)
    _drive_corridor(estimator, 1, 301)
    estimator.apply("landmarks", Fix(30.0, Pose2(15.0), information_from_sigmas(0.05, 0.05, 0.02)))
    _drive_corridor(estimator, 301, 321)
    belief = estimator.belief(32.0)
    assert belief.covariance is not None
    assert 0.9 < math.sqrt(belief.covariance[0, 0]) < 1.5
    _drive_corridor(estimator, 321, 601)
    assert _sigmas_off(estimator.belief(60.0), 30.0) < 3.0


@pytest.mark.parametrize("name", ["kalman", "dead_reckoning"])
def test_estimates_across_the_corridor_leave_the_way_along_it_open(name: str) -> None:
    estimator = _estimator(name)
    for index in range(1, 601):
        _drive_corridor(estimator, index, index + 1)
        across = Fix(index * _DT_S, Pose2(), np.diag([0.0, 400.0, 400.0]))
        estimator.apply("wall", across)
    belief = estimator.belief(60.0)
    assert _sigmas_off(belief, 30.0) < 3.0
    assert "along 0 deg" in belief.health["scan"]


def test_wheels_beside_measure_the_way() -> None:
    kalman = Kalman(KalmanConfig(calibration_sigma=0.0))  # over 30 m that would be 0.15 m by itself
    kalman.start(Session(start_pose=Pose2()))
    for index in range(1, 601):
        _drive_corridor(kalman, index, index + 1)
        wheels = information_from_sigmas(2e-3, 2e-3, 4e-3)
        kalman.apply("wheels", _motion(index, _SPEED_MPS * _DT_S, wheels))
        kalman.apply("gyro", _motion(index, 0.0, np.diag([0.0, 0.0, 1e6])))
    belief = kalman.belief(60.0)
    assert belief.covariance is not None
    assert math.sqrt(belief.covariance[0, 0]) < 0.1
    assert _sigmas_off(belief, 30.0) < 3.0
    assert not belief.health


def test_the_open_direction_turns_with_the_corridor_not_with_base() -> None:
    """Base turns on the spot, and sees the corridor from every side: the way along it stays the one that is open."""
    kalman = _estimator("kalman")
    turn_rad = math.radians(1.5)
    for index in range(1, 301):
        heading = (index - 1) * turn_rad
        cos, sin = math.cos(heading), math.sin(heading)
        information = np.array(
            [[1e6 * sin * sin, 1e6 * cos * sin, 0], [1e6 * cos * sin, 1e6 * cos * cos, 0], [0, 0, 1e9]]
        )
        step = Pose2(0.0, 0.0, turn_rad)
        kalman.apply("scan", Motion((index - 1) * _DT_S, index * _DT_S, step, information))
    belief = kalman.belief(30.0)
    assert _sigmas_off(belief, 15.0) < 3.0
    assert belief.covariance is not None
    assert math.sqrt(belief.covariance[1, 1]) < 1.0
    assert "along -90 deg" in belief.health["scan"] or "along 90 deg" in belief.health["scan"]
