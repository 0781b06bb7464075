"""Seconds that no localizer measures: whatever the robot does in them, the belief covers it, and finds back."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.estimates import Belief, Fix, Motion, information_from_sigmas
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.smoother.estimator import Smoother
from trailmark.estimation.smoother_config import SmootherConfig
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Estimator, Session

_DT_S = 0.1
_WHEELS, _LASER = (2e-3, 1e-3, 4e-3), (0.02, 0.02, 0.01)
_ESTIMATORS = {
    "kalman": lambda: Kalman(KalmanConfig()),
    "ukf": lambda: Kalman(KalmanConfig(filter="ukf")),
    "velocity": lambda: Kalman(KalmanConfig(model="velocity")),
    "smoother": lambda: Smoother(SmootherConfig()),
    "dead_reckoning": lambda: DeadReckoning(DeadReckoningConfig()),
}


class Drive:
    """A robot whose wheels are heard, or not, while it drives."""

    def __init__(self, name: str, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.estimator: Estimator = _ESTIMATORS[name]()
        self.estimator.start(Session(start_pose=Pose2()))
        self.truth, self.stamp_s = Pose2(), 0.0

    def go(self, duration_s: float, speed_mps: float, yaw_radps: float, *, is_heard: bool) -> None:
        for _ in range(round(duration_s / _DT_S)):
            since_s, self.stamp_s = self.stamp_s, round(self.stamp_s + _DT_S, 9)
            step = Pose2(speed_mps * _DT_S, 0.0, yaw_radps * _DT_S)
            self.truth = self.truth @ step
            if is_heard:
                told = Pose2.from_array(step.array() + self.rng.normal(0.0, _WHEELS))
                self.estimator.apply("wheels", Motion(since_s, self.stamp_s, told, information_from_sigmas(*_WHEELS)))

    def fix(self) -> str:
        seen = Pose2.from_array(self.truth.array() + self.rng.normal(0.0, _LASER))
        return self.estimator.apply("laser", Fix(self.stamp_s, seen, information_from_sigmas(*_LASER))).status

    def belief(self) -> Belief:
        return self.estimator.belief(self.stamp_s)

    def errors(self) -> tuple[Floats, Floats]:
        """Return the errors of the belief, and what it says of them, both (3,)."""
        belief = self.belief()
        assert belief.pose_map_base is not None
        assert belief.covariance is not None
        errors = belief.pose_map_base.array() - self.truth.array()
        errors[2] = wrap_angle(float(errors[2]))
        return np.abs(errors), np.sqrt(np.diag(belief.covariance))


@pytest.mark.parametrize("name", list(_ESTIMATORS))
@pytest.mark.parametrize("gap_s", [2.0, 10.0, 30.0])
def test_whatever_the_robot_does_in_a_gap_the_belief_covers_it_and_finds_back(name: str, gap_s: float) -> None:
    """It drives on, slowly or fast, stops, or turns; at the end of the gap, 2 s later, and with the first fixes."""
    squares = []
    for seed, (before_mps, in_gap_mps, yaw_radps) in enumerate(
        [(0.5, 0.5, 0.0), (1.0, 1.0, 0.02), (2.0, 2.0, 0.0), (2.0, 0.0, 0.0), (1.0, 0.7, 0.15), (0.5, 1.2, 0.0)]
    ):
        drive = Drive(name, seed)
        drive.go(2.0, before_mps, 0.0, is_heard=True)
        drive.go(gap_s, in_gap_mps, yaw_radps, is_heard=False)

        errors, sigmas = drive.errors()
        squares.append(float(((errors / sigmas)[:2] ** 2).mean()))
        assert (errors < 3.0 * sigmas).all(), (before_mps, in_gap_mps)
        drive.go(2.0, in_gap_mps, yaw_radps, is_heard=True)
        errors, sigmas = drive.errors()
        assert (errors < 4.0 * sigmas).all(), (before_mps, in_gap_mps)

        for _ in range(3):
            drive.go(_DT_S, in_gap_mps, 0.0, is_heard=True)
            assert drive.fix() == "accepted"
        errors, sigmas = drive.errors()
        assert (errors < 4.0 * sigmas).all()
        assert (sigmas < 0.03).all()
    assert 0.1 < np.mean(squares) < 2.0


@pytest.mark.parametrize("name", list(_ESTIMATORS))
@pytest.mark.parametrize("gap_s", [61.0, 180.0, 1800.0])
def test_a_silence_that_looks_like_a_clock_that_was_set_is_covered_as_a_gap(name: str, gap_s: float) -> None:
    drive = Drive(name, 1)
    drive.go(5.0, 0.5, 0.02, is_heard=True)
    drive.go(gap_s, 0.5, 0.0, is_heard=False)
    drive.go(3.0, 0.5, 0.0, is_heard=True)

    errors, sigmas = drive.errors()

    assert (errors[:2] < 3.0 * sigmas[:2]).all()


@pytest.mark.parametrize("name", ["kalman", "velocity", "smoother"])
def test_a_fix_in_a_gap_begins_it_anew(name: str) -> None:
    """How fast the robot is stays unknown, but how far it has come is known: a second later it is 1 m, not 10 m."""
    drive = Drive(name, 1)
    drive.go(2.0, 0.5, 0.0, is_heard=True)
    drive.go(20.0, 0.5, 0.0, is_heard=False)
    assert drive.fix() == "accepted"
    drive.go(1.0, 0.5, 0.0, is_heard=False)

    errors, sigmas = drive.errors()

    assert (errors[:2] < 3.0 * sigmas[:2]).all()
    assert (sigmas[:2] > 0.3).all()
    assert (sigmas[:2] < 1.0).all()


@pytest.mark.parametrize("model", ["pose", "velocity"])
def test_a_gap_is_as_uncertain_in_pieces_as_in_one(model: str) -> None:
    """Estimates of a compass cut it, and say nothing of the way."""
    sigmas = []
    for period_s in (20.0, 0.5):
        drive = Drive("velocity" if model == "velocity" else "kalman", 1)
        drive.go(2.0, 1.0, 0.0, is_heard=True)
        for _ in range(round(20.0 / period_s)):
            drive.go(period_s, 0.0, 0.0, is_heard=False)
            compass = Fix(drive.stamp_s, drive.truth, np.diag([0.0, 0.0, 1e2]))
            drive.estimator.apply("compass", compass)
        sigmas.append(drive.errors()[1][:2])

    np.testing.assert_allclose(sigmas[1], sigmas[0], rtol=0.02)


def test_wheels_that_fall_silent_beside_a_gyro_leave_the_way_open() -> None:
    """The gyro goes on alone; that the robot has stopped from 2 m/s is no surprise."""
    drive = Drive("kalman", 1)
    drive.go(2.0, 2.0, 0.0, is_heard=True)
    for _ in range(200):
        since_s = drive.stamp_s
        drive.go(_DT_S, 0.0, 0.0, is_heard=False)
        still = Motion(since_s, drive.stamp_s, Pose2(), np.diag([0.0, 0.0, 1e8]))
        drive.estimator.apply("gyro", still)

    errors, sigmas = drive.errors()

    assert (errors[:2] < 3.0 * sigmas[:2]).all()
    assert math.degrees(sigmas[2]) < 2.0
