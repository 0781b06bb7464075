"""A scale or a drift that is wrong does not average out: the belief says so, and follows the way it always has."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pytest

from trailmark.estimates import Belief, Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.diagnosis import MotionSum
from trailmark.estimation.kalman.lasting_errors import NO_ERRORS, LastingPrior
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.geometry import Pose2, wrap_angle

from .conftest import kalman, pose_of

DT_S = 0.05
NOISE = (5e-4, 5e-4, 5e-4)
# Wheels that allow for soft ground, as the defaults of `odometry`.
HUMBLE, PRECISE = (2e-2, 1e-2, 3e-2), (6e-4, 6e-4, 6e-4)
#: What a localizer says of a true step.
Says = Callable[[Pose2], Pose2]
#: What absolute estimate there is at an instant [s], of a true pose.
Fixes = Callable[[float, Pose2], Fix | None]


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


def no_fix(stamp_s: float, pose: Pose2) -> Fix | None:
    return None


def fixes_every(
    every_s: float, sigmas: tuple[float, float, float], *, off: Pose2 | None = None, since_s: float = 0.0
) -> Fixes:
    def fix(stamp_s: float, pose: Pose2) -> Fix | None:
        if stamp_s < since_s or round(stamp_s / DT_S) % round(every_s / DT_S):
            return None
        return Fix(stamp_s, pose @ (off or Pose2()), information_from_sigmas(*sigmas))

    return fix


def drive(
    says: dict[str, tuple[Says, tuple[float, float, float]]],
    *,
    until_s: float = 20.0,
    bend: float = 0.0,
    fixes: Fixes = no_fix,
    every: int = 1,
    seed: int = 5,
    **config: float,
) -> Told:
    rng, estimator, told, pose = np.random.default_rng(seed), kalman(**config), Told(), Pose2()
    steps: dict[str, Pose2] = {}
    for i in range(1, round(until_s / DT_S) + 1):
        t = DT_S * i
        step = Pose2.exp(0.5 * min(t, 1.0) * DT_S, 0.0, bend * math.sin(0.57 * t) * DT_S)
        pose = pose @ step
        for name, (says_of, sigmas) in says.items():
            said, (dx, dy, turn) = says_of(step), (rng.normal(size=3) * NOISE).tolist()
            steps[name] = steps.get(name, Pose2()) @ Pose2(said.x + dx, said.y + dy, said.theta + turn)
            if i % every == 0:
                spread = information_from_sigmas(*(math.sqrt(every) * sigma for sigma in sigmas))
                estimator.apply(name, Motion(t - every * DT_S, t, steps.pop(name), spread))
        fix = fixes(t, pose)
        if fix is not None:
            estimator.apply("map", fix)
        if i % max(5, every) == 0:
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
    told = drive({"wheels": (honest, HUMBLE), "laser": (scaled(1.03), PRECISE), "second": (honest, HUMBLE)})

    health = told.beliefs[-1].health
    assert set(health) == {"laser"}
    assert "steadily: others agree with" in health["laser"]
    assert max(told.sigmas) < 5.0


def test_what_was_told_of_the_way_is_held_while_it_is_told() -> None:
    steps = iter(range(400))

    def wrong_at_first(step: Pose2) -> Pose2:
        return scaled(1.1 if next(steps) < 160 else 1.0)(step)

    told = drive({"wheels": (honest, HUMBLE), "floor": (wrong_at_first, PRECISE)})

    assert not told.is_silent()
    held = [one.covariance[0, 0] for one in told.beliefs[32:] if one.covariance is not None and one.health]
    assert len(held) == 48
    assert all(after >= before for before, after in pairwise(held))


@pytest.mark.parametrize(
    ("every_s", "sigmas"),
    [(0.1, (math.inf, math.inf, 0.02)), (0.5, (math.inf, math.inf, 0.02)), (0.5, (0.3, 0.3, math.inf))],
    ids=["compass at 10 Hz", "compass at 2 Hz", "vague positions"],
)
def test_fixes_end_no_doubt_of_what_they_do_not_decide(every_s: float, sigmas: tuple[float, float, float]) -> None:
    says = {"wheels": (honest, HUMBLE), "floor": (scaled(1.05), PRECISE)}

    told = drive(says, fixes=fixes_every(every_s, sigmas))

    assert told.errors_m[-1] > 0.2
    assert max(told.sigmas) < 5.0
    assert "nothing decides" in told.beliefs[-1].health["floor"]


@pytest.mark.parametrize("every", [14, 20])
def test_motions_slower_than_windows_are_compared(every: int) -> None:
    says = {"wheels": (honest, HUMBLE), "floor": (scaled(1.05), PRECISE)}

    told = drive(says, until_s=30.0, every=every)

    assert told.errors_m[-1] > 0.2
    assert told.sigmas[-1] < 5.0
    assert "nothing decides" in told.beliefs[-1].health["floor"]


def test_a_heading_that_is_doubted_leaves_the_position_as_unsure_as_it_was() -> None:
    heading = fixes_every(0.5, (math.inf, math.inf, 0.02), off=Pose2(0.0, 0.0, 0.6), since_s=30.0)

    told = drive({"camera": (scaled(1.02), PRECISE)}, until_s=33.0, fixes=heading)

    assert abs(pose_of(told.beliefs[-1]).theta - 0.6) < 0.05
    assert told.errors_m[-1] > 0.2
    assert max(told.sigmas) < 5.0


def test_a_scale_that_is_estimated_says_nothing_of_another_localizer() -> None:
    config = KalmanConfig.model_validate({"sources": {"wheels": {"errors": "scale"}}})
    prior, moved = LastingPrior.of(config), MotionSum(position_m2=1e-6)
    turned_only = MotionSum(open_ways=9)

    assert prior.with_parting(NO_ERRORS, {"wheels": moved}).along == 0.0
    assert prior.with_parting(NO_ERRORS, {"wheels": moved, "gyro": turned_only}).along == 0.0
    assert prior.with_parting(NO_ERRORS, {"wheels": moved, "camera": moved}).along == config.calibration_sigma**2


def test_what_is_believed_stays_as_it_was() -> None:
    says = {"wheels": (honest, HUMBLE), "floor": (scaled(1.05), PRECISE)}
    fixes = fixes_every(1.0, (0.05, 0.05, 0.03))
    with_prior, without = (drive(says, calibration_sigma=sigma, until_s=5.0, fixes=fixes) for sigma in (0.01, 0.0))

    assert [one.pose_map_base for one in with_prior.beliefs] == [one.pose_map_base for one in without.beliefs]


def test_a_fix_after_a_long_way_is_believed_and_ends_the_doubt() -> None:
    told = drive({"camera": (scaled(1.01), PRECISE)}, until_s=31.0, fixes=fixes_every(30.0, (0.02, 0.02, 0.01)))

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
