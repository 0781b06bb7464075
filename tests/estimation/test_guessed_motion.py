"""A motion that covers what may have been driven in a gap: it counts where no other one measures the way."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Motion, information_along, information_from_sigmas
from trailmark.estimation.information import checked_information
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman.motions import Motions, StatedMotion
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.smoother.estimator import Smoother
from trailmark.estimation.smoother_config import SmootherConfig
from trailmark.estimation.symmetric import diagonal
from trailmark.geometry import Pose2
from trailmark.interfaces import Estimator, Session

_DRIFT = diagonal(0.5**2, 0.5**2, math.radians(30.0) ** 2)
_GAP_S = 6.0
# Wheels that begin where they were, behind a gap in which a robot at 1 m/s may have gone on.
_GUESS = Motion(0.0, _GAP_S, Pose2(), information_from_sigmas(_GAP_S, _GAP_S, math.pi), is_guess=True)


def stated(motion: Motion) -> StatedMotion:
    information = checked_information(motion.information)
    assert not isinstance(information, str)
    return StatedMotion(motion, information)


def heard_of(**motions: Motion) -> set[str]:
    """Return whose steps count in the first second."""
    known = Motions(_DRIFT)
    for name, motion in motions.items():
        known.add(name, stated(motion))
    return {name for name, _ in known.steps(0.0, 1.0)}


def test_a_guess_counts_alone_and_beside_another_one() -> None:
    assert heard_of(wheels=_GUESS) == {"wheels"}
    assert heard_of(wheels=_GUESS, others=_GUESS) == {"wheels", "others"}


def test_a_guess_is_left_aside_where_the_whole_way_is_measured() -> None:
    laser = Motion(0.0, 1.0, Pose2(1.0), information_from_sigmas(0.01, 0.01, 0.01))

    assert heard_of(wheels=_GUESS, laser=laser) == {"laser"}


@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0)])
def test_a_guess_counts_beside_what_leaves_a_direction_open(direction: tuple[float, float, float]) -> None:
    """A gyro, or a counter of the way."""
    partial = Motion(0.0, 1.0, Pose2(), information_along(direction, 0.01))

    assert heard_of(wheels=_GUESS, partial=partial) == {"wheels", "partial"}


def test_a_motion_that_was_measured_coarsely_is_no_guess() -> None:
    """Step by step it is worse than drift, but errs anew each time, and so measures over seconds."""
    laser = Motion(0.0, 1.0, Pose2(0.1), information_from_sigmas(0.01, 0.01, 0.01))
    radar = Motion(0.0, 1.0, Pose2(0.1), information_from_sigmas(1.0, 1.0, 1.0))

    assert heard_of(laser=laser, radar=radar) == {"laser", "radar"}


@pytest.mark.parametrize(
    ("speed_mps", "sigmas", "options"),
    [
        (1.5, (0.26, 0.26, math.radians(11.0)), {}),
        (0.5, (0.02, 0.02, math.radians(1.1)), {"drift_sigma_mps": 0.05, "drift_sigma_deg_per_s": 3.0}),
    ],
)
def test_a_coarse_motion_tells_of_a_laser_that_froze(
    speed_mps: float, sigmas: tuple[float, float, float], options: dict[str, float]
) -> None:
    """The laser says from 5 s on that the robot stands, to 5 mm a step; the other one comes twice a second."""
    rng, kalman = np.random.default_rng(1), Kalman(KalmanConfig.model_validate(options))
    laser_sigmas = 5e-3, 5e-3, 3e-3
    kalman.start(Session(start_pose=Pose2()))
    for i in range(100):
        since_s, stamp_s = 0.2 * i, 0.2 * (i + 1)
        seen = np.array([speed_mps * 0.2 if i < 25 else 0.0, 0.0, 0.0]) + rng.normal(0.0, laser_sigmas)
        told = Motion(since_s, stamp_s, Pose2.from_array(seen), information_from_sigmas(*laser_sigmas))
        kalman.apply("laser", told)
        if (i + 1) % 5 == 0:
            for k in (i // 5 * 2, i // 5 * 2 + 1):
                step = np.array([speed_mps * 0.5, 0.0, 0.0]) + rng.normal(0.0, sigmas)
                told = Motion(0.5 * k, 0.5 * (k + 1), Pose2.from_array(step), information_from_sigmas(*sigmas))
                kalman.apply("radar", told)

    belief = kalman.belief(20.0)

    assert belief.pose_map_base is not None
    assert belief.covariance is not None
    error_m = np.array([belief.pose_map_base.x - 20.0 * speed_mps, belief.pose_map_base.y])
    assert error_m @ np.linalg.solve(belief.covariance[:2, :2], error_m) < 3.0**2
    assert "laser" in belief.health


@pytest.mark.parametrize("options", [{"sigma_scale": 0.1}, {"sigmas": [0.01, 0.01, 1.0]}])
def test_a_config_makes_no_guess_sharp(options: dict[str, object]) -> None:
    """It says how good a localizer is that measures."""
    kalman = Kalman(KalmanConfig.model_validate({"sources": {"wheels": options}}))
    kalman.start(Session(start_pose=Pose2()))

    kalman.apply("wheels", _GUESS)

    covariance = kalman.belief(_GAP_S).covariance
    assert covariance is not None
    assert np.sqrt(np.diag(covariance)).min() > 0.99 * math.pi


@pytest.mark.parametrize("make", [lambda: Kalman(KalmanConfig()), lambda: Smoother(SmootherConfig())])
def test_a_guess_changes_nothing_beside_a_laser(make: type[Estimator]) -> None:
    beliefs = []
    for with_guess in (False, True):
        estimator = make()
        estimator.start(Session(start_pose=Pose2()))
        for i in range(60):
            laser = Motion(0.2 * i, 0.2 * (i + 1), Pose2(0.2), information_from_sigmas(3e-3, 3e-3, 2e-3))
            estimator.apply("laser", laser)
            if with_guess and i == 29:
                estimator.apply("wheels", _GUESS)
        beliefs.append(estimator.belief(12.0))

    alone, beside = beliefs
    assert alone.pose_map_base is not None
    assert beside.pose_map_base is not None
    np.testing.assert_allclose(beside.pose_map_base.array(), alone.pose_map_base.array(), atol=1e-6)
    np.testing.assert_allclose(beside.covariance, alone.covariance, rtol=1e-6)
