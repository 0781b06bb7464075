"""A motion across a gap that is as uncertain as the gap: it counts where no other one measures the way."""

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
_GUESS = Motion(0.0, _GAP_S, Pose2(), information_from_sigmas(_GAP_S, _GAP_S, math.pi))


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


def test_noise_of_a_single_short_step_makes_no_guess() -> None:
    """At 10 Hz a white error of 0.2 m is worse than drift, step by step, and measures over seconds."""
    laser = Motion(0.0, 0.1, Pose2(0.1), information_from_sigmas(0.01, 0.01, 0.01))
    noisy = Motion(0.0, 0.1, Pose2(0.1), information_from_sigmas(0.2, 0.2, 0.5))
    known = Motions(_DRIFT)
    for name, motion in (("laser", laser), ("noisy", noisy)):
        known.add(name, stated(motion))

    assert {name for name, _ in known.steps(0.0, 0.1)} == {"laser", "noisy"}


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
