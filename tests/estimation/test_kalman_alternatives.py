"""A question that nothing has decided is remembered: the belief covers every answer until absolute evidence comes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Belief, Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.alternatives import believed_gaussian, closed_question, reopened_question
from trailmark.estimation.kalman.diagnosis import DetectedFault, FaultDiagnosis, RivalFilter
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman.lasting_errors import UNAFFECTED
from trailmark.estimation.kalman.state import FilterState, Gaussian
from trailmark.geometry import Pose2

from .conftest import kalman, pose_of

DT_S = 0.1
STEP = Pose2.exp(0.4 * DT_S, 0.0, 0.2 * DT_S)
SIGMAS = (2e-3, 2e-3, 2e-3)
FROZEN_S = (5.0, 12.0)
HERE = Fix(0.0, Pose2(), information_from_sigmas(0.02, 0.02, 0.01))


def drive_after_a_freeze(until_s: float) -> tuple[Kalman, list[float]]:
    """Return an estimator after a drive in a circle on which the camera froze for 7 s, and how far it was off.

    In standard deviations of the pose, after the question came up.
    """
    rng = np.random.default_rng(3)
    estimator, pose, sigmas_off = kalman(), Pose2(), []
    for i in range(1, round(until_s / DT_S) + 1):
        stamp_s = DT_S * i
        for name in ("wheels", "camera"):
            is_frozen = name == "camera" and FROZEN_S[0] < stamp_s <= FROZEN_S[1]
            said = Pose2() if is_frozen else STEP @ Pose2(*(rng.normal(size=3) * SIGMAS).tolist())
            estimator.apply(name, Motion(stamp_s - DT_S, stamp_s, said, information_from_sigmas(*SIGMAS)))
        pose = pose @ STEP
        if stamp_s > 7.0:
            sigmas_off.append(mahalanobis(estimator.belief(stamp_s), pose))
    return estimator, sigmas_off


def mahalanobis(belief: Belief, true: Pose2) -> float:
    """Return how far a belief is off, in standard deviations."""
    assert belief.covariance is not None
    away = true.array() - pose_of(belief).array()
    away[2] = math.remainder(away[2], 2.0 * math.pi)
    return math.sqrt(float(away @ np.linalg.solve(belief.covariance, away)))


def true_pose(stamp_s: float) -> Pose2:
    return Pose2.exp(0.4 * stamp_s, 0.0, 0.2 * stamp_s)


@pytest.fixture(scope="module")
def after_a_freeze() -> tuple[Kalman, list[float]]:
    return drive_after_a_freeze(60.0)


def test_the_belief_covers_both_answers_long_after_motions_agree_again(
    after_a_freeze: tuple[Kalman, list[float]],
) -> None:
    estimator, sigmas_off = after_a_freeze

    belief = estimator.belief(60.0)

    assert max(sigmas_off) < 4.0
    assert set(belief.health) == {"wheels", "camera"}
    assert "the belief covers both" in belief.health["wheels"]


@pytest.mark.parametrize("frozen_was_right", [False, True])
def test_absolute_estimates_decide_what_motions_could_not(frozen_was_right: bool) -> None:
    estimator, _ = drive_after_a_freeze(20.0)
    stood_s = FROZEN_S[1] - FROZEN_S[0] if frozen_was_right else 0.0

    for i in range(201, 241):
        stamp_s = DT_S * i
        for name in ("wheels", "camera"):
            estimator.apply(name, Motion(stamp_s - DT_S, stamp_s, STEP, information_from_sigmas(*SIGMAS)))
        if i % 5 == 0:
            estimator.apply("laser", Fix(stamp_s, true_pose(stamp_s - stood_s), HERE.information))

    belief = estimator.belief(24.0)
    assert pose_of(belief).between(true_pose(24.0 - stood_s)).array() == pytest.approx([0.0, 0.0, 0.0], abs=0.05)
    assert belief.covariance is not None
    assert belief.covariance[0, 0] < 0.05**2
    assert not belief.health


def test_a_pose_that_is_set_ends_the_question() -> None:
    estimator, _ = drive_after_a_freeze(20.0)

    estimator.set_pose(Pose2(1.0, 2.0, 0.5))

    belief = estimator.belief()
    assert pose_of(belief) == Pose2(1.0, 2.0, 0.5)
    assert not belief.health


def rival(pose: Pose2, sigma: float, log_weight: float, fault: str) -> RivalFilter:
    diagnosis = FaultDiagnosis(faults={fault: DetectedFault(1.0, "")})
    return RivalFilter(
        FilterState(5.0, Gaussian(pose.array(), sigma**2 * np.eye(3), UNAFFECTED), diagnosis=diagnosis), log_weight
    )


def question(*rivals: RivalFilter) -> FilterState:
    return FilterState(5.0, rivals[0].state.gaussian, diagnosis=FaultDiagnosis(rivals=rivals))


def test_a_closed_question_is_the_mixture_of_its_answers() -> None:
    here = rival(Pose2(1.0, 2.0, 0.1), 0.1, 0.0, "camera")
    there = rival(Pose2(2.0, 2.0, 0.1), 0.1, math.log(1.0 / 3.0), "wheels")

    closed = closed_question(question(there, here))
    believed = believed_gaussian(closed)

    assert believed is not None
    np.testing.assert_allclose(believed.x, [1.25, 2.0, 0.1], atol=1e-12)
    np.testing.assert_allclose(believed.covariance, np.diag([0.01 + 3.0 / 16.0, 0.01, 0.01]), atol=1e-12)
    assert closed.diagnosis.accused == {"camera", "wheels"}
    assert not closed.diagnosis.rivals


def test_answers_next_to_each_other_are_one() -> None:
    closed = closed_question(question(rival(Pose2(), 0.1, 0.0, "camera"), rival(Pose2(0.05), 0.1, 0.0, "wheels")))

    assert not closed.diagnosis.alternatives
    assert not closed.diagnosis.accused
    assert closed.gaussian is not None
    assert closed.gaussian.covariance[0, 0] == pytest.approx(0.01 + 0.5 * 0.05**2)


def test_a_reopened_question_has_the_answers_of_the_closed_one() -> None:
    poses = [Pose2(1.0, 2.0, 0.1), Pose2(2.0, 1.0, 1.1), Pose2(-1.0, 0.0, -2.0)]
    asked = question(*(rival(pose, 0.1, -float(k), "camera") for k, pose in enumerate(poses)))

    reopened = reopened_question(closed_question(asked)).diagnosis.rivals

    for one, before in zip(reopened, asked.diagnosis.rivals):
        assert one.state.gaussian is not None
        assert before.state.gaussian is not None
        np.testing.assert_allclose(one.state.gaussian.x, before.state.gaussian.x, atol=1e-12)
        np.testing.assert_allclose(one.state.gaussian.covariance, before.state.gaussian.covariance, atol=1e-12)
        assert not one.state.diagnosis.faults
    logs = [one.log_weight for one in reopened]
    np.testing.assert_allclose(np.diff(logs), [-1.0, -1.0])


def test_fixes_far_apart_decide_too_and_nobody_honest_stays_accused() -> None:
    rng = np.random.default_rng(3)
    estimator, sigmas_off = kalman(), []
    told = information_from_sigmas(0.02, 0.02, 0.01)
    for i in range(1, 401):
        stamp_s = DT_S * i
        for name in ("wheels", "camera"):
            is_frozen = name == "camera" and FROZEN_S[0] < stamp_s <= FROZEN_S[1]
            said = Pose2() if is_frozen else STEP @ Pose2(*(rng.normal(size=3) * SIGMAS).tolist())
            estimator.apply(name, Motion(stamp_s - DT_S, stamp_s, said, information_from_sigmas(*SIGMAS)))
        if stamp_s > 20.0 and i % 50 == 0:
            off = Pose2(*(rng.normal(size=3) * (0.02, 0.02, 0.01)).tolist())
            estimator.apply("laser", Fix(stamp_s, true_pose(stamp_s) @ off, told))
        if stamp_s > 7.0 and i % 5 == 0:
            sigmas_off.append(mahalanobis(estimator.belief(stamp_s), true_pose(stamp_s)))

    health = estimator.belief(40.0).health
    assert not any("nothing has decided" in told for told in health.values())
    assert max(sigmas_off) < 5.0
