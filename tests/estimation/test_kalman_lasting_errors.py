"""A scale or a drift that is wrong does not average out: the belief says so, and follows the way it always has."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest

from trailmark.estimates import Belief, Fix, Motion, information_from_sigmas
from trailmark.geometry import Pose2, wrap_angle

from .conftest import kalman, pose_of

DT_S = 0.05
NOISE = (5e-4, 5e-4, 5e-4)
# Wheels that allow for soft ground, as the defaults of `odometry`.
HUMBLE, PRECISE = (2e-2, 1e-2, 3e-2), (6e-4, 6e-4, 6e-4)
#: What a localizer says of a true step.
Says = Callable[[Pose2], Pose2]


@dataclass
class Told:
    """What was believed, four times a second."""

    beliefs: list[Belief] = field(default_factory=list)
    errors_m: list[float] = field(default_factory=list)
    sigmas: list[float] = field(default_factory=list)
    turn_sigmas: list[float] = field(default_factory=list)

    def is_silent(self) -> bool:
        """Return whether a position was wrong by more than 20 mm and 5 sigmas."""
        return any(error > 0.02 and sigmas > 5.0 for error, sigmas in zip(self.errors_m, self.sigmas, strict=True))


def drive(
    says: dict[str, tuple[Says, tuple[float, float, float]]],
    *,
    until_s: float = 20.0,
    bend: float = 0.0,
    fix_at_s: float = math.inf,
    seed: int = 5,
    **config: float,
) -> Told:
    rng, estimator, told, pose = np.random.default_rng(seed), kalman(**config), Told(), Pose2()
    for i in range(1, round(until_s / DT_S) + 1):
        t = DT_S * i
        step = Pose2.exp(0.5 * min(t, 1.0) * DT_S, 0.0, bend * math.sin(0.57 * t) * DT_S)
        pose = pose @ step
        for name, (says_of, sigmas) in says.items():
            said, (dx, dy, turn) = says_of(step), (rng.normal(size=3) * NOISE).tolist()
            noisy = Pose2(said.x + dx, said.y + dy, said.theta + turn)
            estimator.apply(name, Motion(t - DT_S, t, noisy, information_from_sigmas(*sigmas)))
        if t >= fix_at_s > t - DT_S:
            estimator.apply("map", Fix(t, pose, information_from_sigmas(0.02, 0.02, 0.01)))
        if i % 5 == 0:
            told.beliefs.append(estimator.belief(t))
            _judge(told, pose)
    return told


def _judge(told: Told, true: Pose2) -> None:
    belief, pose = told.beliefs[-1], pose_of(told.beliefs[-1])
    assert belief.covariance is not None
    away = np.array([pose.x - true.x, pose.y - true.y])
    told.errors_m.append(float(np.hypot(*away)))
    told.sigmas.append(math.sqrt(away @ np.linalg.solve(belief.covariance[:2, :2], away)))
    told.turn_sigmas.append(abs(wrap_angle(pose.theta - true.theta)) / math.sqrt(belief.covariance[2, 2]))


def honest(step: Pose2) -> Pose2:
    return step


def scaled(scale: float) -> Says:
    return lambda step: Pose2(scale * step.x, scale * step.y, step.theta)


def turning(deg_per_s: float) -> Says:
    return lambda step: Pose2(step.x, step.y, step.theta + math.radians(deg_per_s) * DT_S)


@pytest.mark.parametrize("scale", [0.98, 1.02])
def test_a_lone_motion_that_is_two_percent_off_is_covered(scale: float) -> None:
    told = drive({"camera": (scaled(scale), PRECISE)}, until_s=40.0)

    assert told.errors_m[-1] > 0.3
    assert max(told.sigmas) < 5.0


@pytest.mark.parametrize("bend", [0.0, 0.4])
@pytest.mark.parametrize("scale", [0.9, 1.05, 1.1])
def test_a_precise_motion_with_a_wrong_scale_beside_humble_wheels_is_covered_and_told(
    scale: float, bend: float
) -> None:
    told = drive({"wheels": (honest, HUMBLE), "floor": (scaled(scale), PRECISE)}, bend=bend)

    assert told.errors_m[-1] > 0.2
    assert not told.is_silent()
    health = told.beliefs[-1].health
    assert set(health) == {"wheels", "floor"}
    assert "disagree by" in health["floor"]
    assert "nothing decides" in health["wheels"]


def test_a_yaw_rate_that_is_wrong_is_covered_and_told() -> None:
    told = drive({"wheels": (honest, HUMBLE), "floor": (turning(0.5), PRECISE)}, until_s=30.0)

    assert not told.is_silent()
    assert max(told.turn_sigmas) < 5.0
    assert "deg/s" in told.beliefs[-1].health["floor"]


@pytest.mark.parametrize("bend", [0.0, 0.4])
def test_honest_motions_are_not_named_and_little_wider(bend: float) -> None:
    told = drive({"wheels": (honest, HUMBLE), "floor": (honest, PRECISE)}, bend=bend)

    assert not any(belief.health for belief in told.beliefs)
    covariance = told.beliefs[-1].covariance
    assert covariance is not None
    assert math.sqrt(covariance[0, 0]) < 0.01 * 9.75 + 0.03


def test_one_of_three_that_is_outvoted_is_named_alone() -> None:
    says = {"floor": (honest, PRECISE), "laser": (scaled(1.02), PRECISE), "second": (honest, PRECISE)}

    told = drive(says)

    assert set(told.beliefs[-1].health) <= {"laser"}
    assert max(told.sigmas) < 5.0


def test_what_is_believed_stays_as_it_was() -> None:
    says = {"wheels": (honest, HUMBLE), "floor": (scaled(1.05), PRECISE)}
    with_prior, without = (drive(says, calibration_sigma=sigma, until_s=5.0) for sigma in (0.01, 0.0))

    assert [one.pose_map_base for one in with_prior.beliefs] == [one.pose_map_base for one in without.beliefs]


def test_a_fix_after_a_long_way_is_believed_and_ends_the_doubt() -> None:
    told = drive({"camera": (scaled(1.01), PRECISE)}, until_s=31.0, fix_at_s=30.0)

    assert told.errors_m[-6] > 0.1
    assert told.errors_m[-1] < 0.06
    covariance = told.beliefs[-1].covariance
    assert covariance is not None
    assert math.sqrt(covariance[0, 0]) < 0.03


def test_the_order_of_arrival_has_no_part_in_it() -> None:
    def believed(*, is_late: bool) -> Belief:
        estimator, told = kalman(clock_offsets="off", learn_scales=False), []
        for i in range(1, 101):
            t, step = DT_S * i, Pose2(0.02, 0.0, 0.001)
            told.append(("wheels", Motion(t - DT_S, t, step, information_from_sigmas(*HUMBLE))))
            wrong = Pose2(0.022 + 1e-4 * (i % 3), 0.0, 0.001)
            told.append(("floor", Motion(t - DT_S, t, wrong, information_from_sigmas(*PRECISE))))
        if is_late:
            told = [told[k + 5 if k % 10 < 5 else k - 5] for k in range(len(told))]
        for source, motion in told:
            estimator.apply(source, motion)
        return estimator.belief(5.0)

    in_time, late = believed(is_late=False), believed(is_late=True)

    assert in_time.covariance is not None
    assert late.covariance is not None
    assert np.allclose(in_time.covariance, late.covariance, rtol=1e-6, atol=1e-12)
