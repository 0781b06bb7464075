"""Wheels and a laser that tell the same drive: what a corridor left open, and stamps that are late, accuse nobody."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Motion, information_from_sigmas
from trailmark.estimation.kalman.agreement import Tolerance, motion_since, pair_nis
from trailmark.estimation.kalman.diagnosis import MotionSum
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman.motions import MotionStep
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.kalman.weighing import select_steps
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.symmetric import ZERO, diagonal
from trailmark.geometry import Pose2, Twist2

from .conftest import kalman

DT_S = 0.1
WHEELS, LASER = np.array([0.003, 0.002, 0.003]), np.array([0.01, 0.01, 0.004])
ROOM = information_from_sigmas(*LASER)
#: Along it nothing is told, or next to nothing: normals that are not quite parallel.
CORRIDORS = [np.diag([along, 1.0 / LASER[1] ** 2, 1.0 / LASER[2] ** 2]) for along in (0.0, 1e-9)]


def pose_at(stamp_s: float) -> Pose2:
    """Return where a robot is that winds along, and turns by up to 60 degrees a second."""
    turn_s = 1.5 * max(stamp_s, 0.0)
    return Pose2(0.4 * stamp_s, 0.2 * math.sin(0.5 * stamp_s), math.radians(40.0) * (1.0 - math.cos(turn_s)))


def told_of_disagreement(estimator: Kalman, seconds: float, *, open_until_s: float = 0.0, late_s: float = 0.0) -> int:
    """Return how many times, in a drive, the health says that wheels or laser may be wrong."""
    rng, n_told = np.random.default_rng(4), 0
    for index in range(1, round(seconds / DT_S) + 1):
        ends_s = DT_S * (index - 1), DT_S * index
        before, now = (pose_at(stamp_s) for stamp_s in ends_s)
        said = before.between(now) @ Pose2.from_array(WHEELS * rng.standard_normal(3))
        estimator.apply("wheels", Motion(*ends_s, said, information_from_sigmas(*WHEELS)))
        before, now = (pose_at(stamp_s - late_s) for stamp_s in ends_s)
        seen = before.between(now) @ Pose2.from_array(LASER * rng.standard_normal(3))
        information = ROOM if ends_s[0] >= open_until_s else CORRIDORS[index % 2]
        estimator.apply("laser", Motion(*ends_s, seen, information))
        n_told += any("disagree" in said for said in estimator.belief(ends_s[1]).health.values())
    return n_told


def test_a_laser_that_has_left_a_corridor_is_taken_at_its_word() -> None:
    assert not told_of_disagreement(kalman(), 20.0, open_until_s=10.0)


def test_a_laser_whose_stamps_are_late_does_not_lie_where_the_robot_turns() -> None:
    assert not told_of_disagreement(kalman(), 20.0, late_s=0.1)


def test_what_one_step_leaves_open_is_open_in_its_window_alone() -> None:
    open_way = MotionSum(1.0, 0.0, 0.1, 1e-6, 1e-6, 1.0, open_ways=10**6)
    states = [
        FilterState(t, None).with_diagnosis(FilterState(t, None).diagnosis._replace(sums={"laser": motion}))
        for t, motion in enumerate(
            (MotionSum(), open_way, open_way._replace(x=2.0, position_m2=3e-6, turn_rad2=2e-6, covered_s=2.0))
        )
    ]

    over_all, later = (motion_since(states[2], states[k], "laser") for k in (0, 1))

    assert over_all is not None
    assert later is not None
    assert over_all.position_m2 == math.inf
    assert later.position_m2 == pytest.approx(2e-6)
    assert pair_nis(over_all, over_all, Tolerance(0.0, 0.0), way_m=1.0, dt_s=2.0)[1] == 1
    assert pair_nis(later, later, Tolerance(0.0, 0.0), way_m=1.0, dt_s=1.0)[1] == 3


def test_late_stamps_are_allowed_for_where_the_velocity_changes() -> None:
    one, other = MotionSum(turn=0.1, covered_s=1.0), MotionSum(turn=0.0, covered_s=1.0)
    tolerance = Tolerance.of(KalmanConfig(agree_scale=0.0, agree_deg_per_s=0.0, agree_late_s=0.05))
    steady, turning = (
        pair_nis(one, other._replace(position_m2=1.0, turn_rad2=1e-6), tolerance, way_m=0.0, dt_s=1.0, change=change)
        for change in ((0.0, 0.0), (0.0, 1.0))
    )

    assert steady[0] == pytest.approx(1e4)
    assert turning[0] == pytest.approx(0.1**2 / (0.05**2 + 1e-6))


def test_a_step_that_tells_nothing_beside_two_that_disagree_counts_for_nothing() -> None:
    sure, drift = diagonal(1e-4, 1e-4, 1e-4), diagonal(1.0, 1.0, 1.0)
    told = {"wheels": (0.1, sure, None), "camera": (0.3, sure, None), "laser": (0.0, None, ZERO)}
    steps = [(name, MotionStep(x, 0.0, 0.0, spread, said, Twist2())) for name, (x, spread, said) in told.items()]

    selection = select_steps(steps, 0.1, Twist2(), drift, lambda _: 0.999)

    assert not selection.left_out
    assert selection.steps[0][1].covariance is not None
    assert selection.steps[0][1].covariance[0] > 10.0 * sure[0]


def off_after_a_corridor(said_mps: float) -> tuple[float, float]:
    """Return by how much the laser's hypothesis is off along a corridor, and its standard deviation [m].

    The wheels are accused of a turn that the laser did not see. Then the robot goes on at 0.3 m/s for 12 s, in steps of
    3 s; the laser measures all but the way, and the wheels say a speed.
    """
    estimator, end_s = kalman(), 0.0

    def tell(dt_s: float, wheels: Pose2, laser: Pose2, information: np.ndarray) -> float:
        ends_s = end_s, end_s + dt_s
        estimator.apply("wheels", Motion(*ends_s, wheels, information_from_sigmas(*WHEELS)))
        estimator.apply("laser", Motion(*ends_s, laser, information))
        return ends_s[1]

    for _ in range(5):
        end_s = tell(1.0, Pose2(0.3), Pose2(0.3), ROOM)
    for _ in range(2):
        end_s = tell(1.0, Pose2(theta=0.5), Pose2(), ROOM)
    for _ in range(4):
        end_s = tell(3.0, Pose2(3.0 * said_mps), Pose2(), CORRIDORS[0])
    rivals = estimator._timeline.state_at(end_s).diagnosis.rivals
    gaussian = next(one.state.gaussian for one in rivals if "wheels" in one.state.diagnosis.faults)
    assert gaussian is not None
    return float(gaussian.x[0]) - 0.3 * 17.0, math.sqrt(float(gaussian.covariance[0, 0]))


def test_wheels_accused_of_a_wrong_turn_still_tell_the_way_along_a_corridor() -> None:
    off_m, sigma_m = off_after_a_corridor(said_mps=0.3)

    assert abs(off_m) < 0.1
    assert sigma_m > 1.0  # as uncertain as a gap


def test_accused_wheels_tell_no_way_that_a_gap_would_not_cover() -> None:
    off_m, sigma_m = off_after_a_corridor(said_mps=5.0)

    assert abs(off_m) < 2.0 * sigma_m
