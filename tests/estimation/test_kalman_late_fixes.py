"""Fixes that are outvoted since their clock is late, and motions that stop as no robot stops: right, or covered."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from types import ModuleType

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.estimates import Belief, Estimate, Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.clock_shift import beside_another_clock
from trailmark.estimation.kalman.diagnosis import DetectedFault, FixOffset
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman.lasting_errors import UNAFFECTED
from trailmark.estimation.kalman.moving_offset import MovingOffset
from trailmark.estimation.kalman.state import FilterState, Gaussian, OdometryState
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import Session

DT_S, FIX_EVERY = 0.05, 5
SIGMAS = {"wheels": (2e-3, 1e-3, 4e-3), "camera": (6e-4, 6e-4, 6e-4), "laser": (0.02, 0.02, 0.01)}


def way(seconds: float) -> list[Pose2]:
    """A winding way at half a metre a second, more or less."""
    poses = [Pose2()]
    for i in range(round(seconds / DT_S)):
        forward_mps = 0.5 + 0.15 * math.sin(2.0 * math.pi * i * DT_S / 7.0)
        yaw_radps = 0.4 * math.sin(2.0 * math.pi * i * DT_S / 11.0)
        poses.append(poses[-1] @ Pose2.exp(forward_mps * DT_S, 0.0, yaw_radps * DT_S))
    return poses


def told(
    poses: list[Pose2], late_s: float, seed: int, frozen_s: float = math.inf
) -> Iterator[tuple[int, str, Estimate]]:
    """Wheels, a camera that freezes at some time, and a laser whose stamps are late."""
    rng, behind = np.random.default_rng(seed), round(late_s / DT_S)
    for i, (before, now) in enumerate(pairwise(poses), start=1):
        for source in ("wheels", "camera"):
            is_frozen = source == "camera" and i * DT_S > frozen_s
            step = (0.0 if is_frozen else before.between(now).array()) + rng.normal(size=3) * SIGMAS[source]
            information = information_from_sigmas(*SIGMAS[source])
            yield i, source, Motion((i - 1) * DT_S, i * DT_S, Pose2(*step.tolist()), information)
        if i % FIX_EVERY == 0:
            pose = poses[max(i - behind, 0)].array() + rng.normal(size=3) * SIGMAS["laser"]
            yield i, "laser", Fix(i * DT_S, Pose2(*pose.tolist()), information_from_sigmas(*SIGMAS["laser"]))


def driven(estimator: Kalman, said: Iterator[tuple[int, str, Estimate]]) -> dict[int, Belief]:
    """Return the belief at each step."""
    estimator.start(Session(start_pose=Pose2()))
    beliefs = {}
    for i, source, estimate in said:
        estimator.apply(source, estimate)
        if source == "camera":
            beliefs[i - 1] = estimator.belief((i - 1) * DT_S)
    return beliefs


def errors_of(beliefs: dict[int, Belief], poses: list[Pose2], since_s: float) -> tuple[Floats, Floats]:
    """Return how far beliefs are off from a time on, and their standard deviations, (n,) [m]."""
    off, sigmas = [], []
    for i, belief in beliefs.items():
        assert belief.pose_map_base is not None
        assert belief.covariance is not None
        if i * DT_S > since_s:
            off.append(belief.pose_map_base.distance_to(poses[i]))
            sigmas.append(math.sqrt(np.trace(belief.covariance[:2, :2]) / 2.0))
    return np.array(off), np.array(sigmas)


@pytest.mark.parametrize("seed", [1, 5, 9])  # of twelve seeds those that were worst before
def test_a_laser_that_is_late_from_the_start_is_found_and_used(seed: int) -> None:
    poses, estimator = way(35.0), Kalman(KalmanConfig())

    off_m, sigma_m = errors_of(driven(estimator, told(poses, 0.2, seed)), poses, 16.0)

    assert estimator.clock_offsets()["laser"].late_s == pytest.approx(0.2, abs=0.06)
    assert math.sqrt(np.mean(off_m**2)) < 0.03
    assert np.mean(off_m > np.maximum(5.0 * sigma_m, 0.02)) < 0.02


@pytest.mark.parametrize("seed", [1, 5, 9])
def test_a_camera_that_freezes_beside_a_laser_known_to_be_late_is_not_believed_and_others_are(seed: int) -> None:
    poses, estimator = way(35.0), Kalman(KalmanConfig())

    beliefs = driven(estimator, told(poses, 0.2, seed, frozen_s=25.0))
    off_m, sigma_m = errors_of(beliefs, poses, 27.0)

    health = beliefs[max(beliefs)].health
    assert {name for name, words in health.items() if "not believed" in words} == {"camera"}, health
    assert np.mean(off_m > np.maximum(5.0 * sigma_m, 0.02)) < 0.02


@pytest.mark.parametrize("seed", [21, 22])
def test_honest_stamps_are_let_be(seed: int) -> None:
    poses, estimator = way(20.0), Kalman(KalmanConfig())

    off_m, sigma_m = errors_of(driven(estimator, told(poses, 0.0, seed)), poses, 2.0)

    assert not estimator.clock_offsets()
    assert np.max(off_m / sigma_m) < 4.5


@pytest.mark.parametrize("mode", ["tell", "off"])
def test_a_delay_is_not_used_where_nobody_wants_it(mode: str) -> None:
    poses, estimator = way(12.0), Kalman(KalmanConfig.model_validate({"clock_offsets": mode}))

    driven(estimator, told(poses, 0.2, 1))

    assert ("laser" in estimator.clock_offsets()) is (mode == "tell")
    assert "stamps_corrected" not in estimator.counters()


def test_an_offset_is_told_as_a_delay_where_nothing_else_explains_it_as_well() -> None:
    late = FixOffset(np.zeros(3), 5, log_constant=-20.0, late_s=0.2, variance_s2=4e-4, log_late=-13.0)
    none = np.zeros(3)
    drawn = MovingOffset(0.0, Pose2(), none, none, none, none, none, -12.0)

    assert late.late == pytest.approx((0.2, 0.02))
    assert late._replace(log_constant=-15.0).late is None  # as on an even way
    assert late._replace(variance_s2=2.5e-3).late is None
    assert late._replace(late_s=-0.2).late is None  # nothing is told from the future
    assert late._replace(moving=drawn).late is None


def test_a_belief_that_has_followed_another_clock_is_off_by_its_way_and_accuses_nobody() -> None:
    odometry = OdometryState(twist=Twist2(2.0, 0.0, 0.4))
    state = FilterState(1.0, Gaussian(np.zeros(3), 1e-4 * np.eye(3), UNAFFECTED), odometry=odometry)
    state = state.with_diagnosis(state.diagnosis._replace(faults={"camera": DetectedFault(0.5, "it differs")}))

    beside = beside_another_clock(state, 0.2)

    assert beside.gaussian is not None
    sigmas = np.sqrt(np.diag(beside.gaussian.covariance))
    assert sigmas.tolist() == pytest.approx([0.4, 0.4, 0.1], rel=0.01)
    assert not beside.diagnosis.faults


@pytest.fixture(scope="module")
def liars(load_script: Callable[[str], ModuleType]) -> ModuleType:
    return load_script("benchmarks/liars.py")


@pytest.mark.parametrize("seed", [4, 25])
def test_two_that_stop_at_once_and_agree_are_covered_beside_a_laser_that_goes_on(liars: ModuleType, seed: int) -> None:
    """Two motions outvoted the laser, by 100 to 16, and while they were compared its poses covered nothing."""
    run = liars.run("two agree", "all", 2.0, seed)

    outside = (run.errors_m > 5.0 * run.sigmas_m) & (run.errors_m > 0.05)
    assert outside.mean() < 0.04  # before the laser's first pose contradicts
