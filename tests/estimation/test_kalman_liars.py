"""Localizers that lie with a normal covariance: found, named, without weight, and believed again."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import pairwise, permutations

import numpy as np
import pytest

from trailmark.estimates import Belief, Estimate, Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.geometry import Pose2

from .conftest import kalman, pose_of

DT_S, SPEED_MPS = 0.05, 0.5
STEP = SPEED_MPS * DT_S
SIGMAS = {"wheels": (2e-3, 1e-3, 4e-3), "camera": (6e-4, 6e-4, 6e-4)}
LASER = information_from_sigmas(0.02, 0.02, 0.01)

Lie = Callable[[Pose2, int], Pose2]


def drive(
    *, until_s: float, lies: Mapping[str, Lie], lie: tuple[float, float] = (5.0, 8.0), has_laser: bool = True
) -> list[tuple[str, Estimate]]:
    """Return what wheels, camera and laser say of a straight way at 0.5 m/s."""
    rng = np.random.default_rng(3)
    said: list[tuple[str, Estimate]] = []
    for i in range(1, round(until_s / DT_S) + 1):
        stamp_s = DT_S * i
        for name, sigmas in SIGMAS.items():
            dx, dy, turn = (rng.normal(size=3) * sigmas).tolist()
            step = Pose2(STEP + dx, dy, turn)
            if name in lies and lie[0] < stamp_s <= lie[1]:
                step = lies[name](step, i)
            said.append((name, Motion(stamp_s - DT_S, stamp_s, step, information_from_sigmas(*sigmas))))
        if has_laser and i % 5 == 0:
            dx, dy, turn = (rng.normal(size=3) * (0.02, 0.02, 0.01)).tolist()
            said.append(("laser", Fix(stamp_s, Pose2(STEP * i + dx, dy, turn), LASER)))
    return said


def tell(estimator: Kalman, said: list[tuple[str, Estimate]]) -> None:
    for name, estimate in said:
        estimator.apply(name, estimate)


def error_of(belief: Belief) -> tuple[float, float]:
    """Return the error of the position, and how many standard deviations it is."""
    assert belief.covariance is not None
    pose = pose_of(belief)
    error_m = math.hypot(pose.x - SPEED_MPS * belief.stamp_s, pose.y)
    return error_m, error_m / math.sqrt((belief.covariance[0, 0] + belief.covariance[1, 1]) / 2.0)


def scaled_by(factor: float) -> Lie:
    return lambda step, i: Pose2(factor * step.x, factor * step.y, step.theta)


LIES: dict[str, tuple[str, Lie]] = {
    "the camera is frozen": ("camera", scaled_by(0.0)),
    "the encoder is stuck": ("wheels", lambda step, i: Pose2()),
    "the camera's scale is 1.3": ("camera", scaled_by(1.3)),
    "one wheel slips": ("wheels", lambda step, i: Pose2(1.25 * step.x, step.y, step.theta - step.x / 0.8)),
    "the camera turns by 5 deg/s": ("camera", lambda step, i: Pose2(step.x, step.y, step.theta + math.radians(0.25))),
    "the camera jumps": ("camera", lambda step, i: Pose2(step.x, step.y + (i % 20 == 1), step.theta)),
    "the camera says 1e12 times the way": ("camera", scaled_by(1e12)),
}


@pytest.mark.parametrize("what", LIES)
def test_a_lying_motion_is_named_and_has_no_weight(what: str) -> None:
    liar, lie = LIES[what]
    estimator = kalman()
    named: dict[str, float] = {}
    errors = []

    for name, estimate in drive(until_s=8.0, lies={liar: lie}):
        estimator.apply(name, estimate)
        if name == "camera" and estimate.stamp_s > 5.0:
            belief = estimator.belief(estimate.stamp_s)
            errors.append(error_of(belief)[0])
            for source in belief.health:
                named.setdefault(source, estimate.stamp_s - 5.0)

    assert set(named) == {liar}
    assert named[liar] <= 2.0
    assert np.sqrt(np.mean(np.square(errors))) < 0.02
    assert error_of(estimator.belief(8.0))[1] < 4.0


def test_a_liar_that_agrees_again_is_believed_again() -> None:
    estimator = kalman()
    tell(estimator, drive(until_s=12.0, lies={"camera": scaled_by(0.0)}))

    belief = estimator.belief(12.0)

    assert not belief.health
    assert error_of(belief)[0] < 0.02
    assert estimator.apply("camera", Motion(12.0, 12.05, Pose2(STEP), LASER)).status == "accepted"


def test_two_that_agree_on_a_lie_lose_against_fixes() -> None:
    estimator = kalman()
    tell(estimator, drive(until_s=7.5, lies={"camera": scaled_by(0.0), "wheels": scaled_by(0.0)}))

    belief = estimator.belief(7.5)

    assert set(belief.health) == {"camera", "wheels"}
    assert "absolute estimates contradict it" in belief.health["camera"]
    assert error_of(belief)[1] < 4.0


@pytest.mark.parametrize(("liar", "factor"), [("camera", 0.0), ("wheels", 0.0), ("camera", 1.3), ("wheels", 1.3)])
def test_where_nothing_decides_the_belief_covers_both_and_says_so(liar: str, factor: float) -> None:
    estimator = kalman()
    tell(estimator, drive(until_s=9.0, lies={liar: scaled_by(factor)}, lie=(5.0, 9.0), has_laser=False))

    belief = estimator.belief(9.0)

    assert error_of(belief)[1] < 4.0
    assert set(belief.health) == {"camera", "wheels"}
    assert "nothing decides" in belief.health["camera"]
    assert belief.covariance is not None
    assert belief.covariance[0, 0] ** 0.5 > 0.05


def test_odometry_does_not_jump_while_hypotheses_change() -> None:
    estimator, poses = kalman(), []
    for name, estimate in drive(until_s=10.0, lies={"camera": scaled_by(0.0)}):
        estimator.apply(name, estimate)
        if name == "camera":
            poses.append(estimator.belief(estimate.stamp_s).pose_odom_base)

    assert max(a.distance_to(b) for a, b in pairwise(poses)) < 2.0 * STEP


def test_while_nothing_decides_odometry_goes_on_by_who_has_spoken() -> None:
    # The second one tells of each second when the first has: it matches a scan to where odometry leads.
    estimator, informations = (
        kalman(),
        (information_from_sigmas(0.02, 0.02, 0.02), information_from_sigmas(3e-3, 3e-3, 3e-3)),
    )
    turn, lie = Pose2(0.3, 0.0, 0.5), Pose2(0.3, 0.0, 0.9)
    errors = []
    for k in range(12):
        steps = (turn if k % 2 else Pose2(0.3), lie if k % 2 and k > 4 else turn if k % 2 else Pose2(0.3))
        before = estimator.belief(float(k))
        estimator.apply("wheels", Motion(float(k), k + 1.0, steps[0], informations[0]))
        ahead = estimator.belief(k + 1.0)
        step = before.pose_odom_base.between(ahead.pose_odom_base)
        errors.append((step.distance_to(steps[0]), abs(step.between(steps[0]).theta)))
        estimator.apply("camera", Motion(float(k), k + 1.0, steps[1], informations[1]))

    assert "nothing decides" in estimator.belief(12.0).health["camera"]
    assert np.max(errors) < 1e-6


def test_a_decision_does_not_depend_on_the_order_of_arrival() -> None:
    said = drive(until_s=6.5, lies={"camera": scaled_by(0.0)})
    end = [one for one in said if one[1].stamp_s > 5.9]
    poses = []
    for order in list(permutations(range(4)))[::5]:
        estimator = kalman()
        tell(estimator, [one for one in said if one[1].stamp_s <= 5.9])
        tell(estimator, [one for k in order for one in end[k::4]])
        poses.append(pose_of(estimator.belief(6.5)).array())

    for pose in poses[1:]:
        np.testing.assert_allclose(pose, poses[0], atol=1e-9)


def test_a_pose_that_is_not_on_earth_is_refused() -> None:
    applied = kalman().apply("laser", Fix(1.0, Pose2(3e12), LASER))

    assert applied.status == "refused"
    assert "no place on Earth" in applied.reason


def test_one_observation_counts_once_however_often_it_is_told() -> None:
    once, often = kalman(start_sigma_m=0.1), kalman(start_sigma_m=0.1)
    for estimator, n in ((once, 1), (often, 5)):
        for k in range(n):
            estimator.apply("laser", Fix(1.0 + 1e-9 * k, Pose2(0.05), LASER))

    assert often.counters()["refused_repeated"] == 4
    np.testing.assert_allclose(often.belief(1.0).covariance, once.belief(1.0).covariance, rtol=1e-6)
