"""Two motions that part by a velocity, a share of the turn or before many windows are over: the belief covers both."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest

from trailmark.estimates import Belief, Motion, information_from_sigmas
from trailmark.estimation.kalman.lasting_errors import UNAFFECTED, LastingVariances, lasting_covariance
from trailmark.estimation.kalman.parting import PartingLog
from trailmark.geometry import Pose2, wrap_angle

from .conftest import kalman, pose_of

DT_S = 0.05


@dataclass(frozen=True)
class Says:
    """How a localizer is wrong, and its noise: [m] and [deg] after a metre, as real and as stated."""

    scale: float = 1.0
    turn_scale: float = 1.0
    ahead_mps: float = 0.0
    turn_dps: float = 0.0
    noise: tuple[float, float] = (5e-4, 0.02)
    stated: float = 1.0


WHEELS = Says(noise=(9e-3, 0.6), stated=3.3)
#: Legs: length [s], speed [m/s] and yaw rate [deg/s].
Legs = Sequence[tuple[float, float, float]]
SHUTTLE: Legs = [(4, 0.5, 0), (4, -0.5, 0)] * 3
SPIN: Legs = [(2, 0.3, 0), (10, 0, 60), (4, 0.3, 0)]


@dataclass
class Drive:
    """What was believed: errors over sigmas, of what is wrong by more than 20 mm or 1 deg, and what the health said."""

    position: list[float] = field(default_factory=list)
    heading: list[float] = field(default_factory=list)
    said: dict[str, set[str]] = field(default_factory=dict)
    heading_sigma_rad: float = 0.0

    @property
    def worst(self) -> float:
        return max([*self.position, *self.heading])  # a drive on which nothing is wrong proves nothing

    def judge(self, belief: Belief, true: Pose2) -> None:
        pose, covariance = pose_of(belief), belief.covariance
        assert covariance is not None
        self.heading_sigma_rad = math.sqrt(covariance[2, 2])
        away, turn = np.array([pose.x - true.x, pose.y - true.y]), abs(wrap_angle(pose.theta - true.theta))
        if np.hypot(*away) > 0.02:
            self.position.append(math.sqrt(away @ np.linalg.solve(covariance[:2, :2], away)))
        if turn > math.radians(1.0):
            self.heading.append(turn / math.sqrt(covariance[2, 2]))
        for source, words in belief.health.items():
            self.said.setdefault(source, set()).add(words)


def steps_of(legs: Legs) -> Iterator[Pose2]:
    v = w = 0.0
    for length_s, to_mps, to_dps in legs:
        for _ in range(round(length_s / DT_S)):
            v += min(max(to_mps - v, -1.5 * DT_S), 1.5 * DT_S)
            w += min(max(math.radians(to_dps) - w, -4.0 * DT_S), 4.0 * DT_S)
            yield Pose2.exp(v * DT_S, 0.0, w * DT_S)


def drive(legs: Legs, localizers: dict[str, Says], *, seed: int = 3, every: int = 1) -> Drive:
    rng, estimator, told, pose = np.random.default_rng(seed), kalman(), Drive(), Pose2()
    sums = dict.fromkeys(localizers, (Pose2(), 0.0, 0.0))
    for i, step in enumerate(steps_of(legs), start=1):
        t, pose = DT_S * i, pose @ step
        way_m, turn = math.hypot(step.x, step.y), abs(step.theta)
        moving_s = DT_S if way_m > 0.0 or turn > 0.0 else 0.0
        for name, says in localizers.items():
            sigma_m = math.hypot(says.noise[0] * math.sqrt(way_m), 1e-5)
            sigma_rad = math.hypot(math.radians(says.noise[1]) * math.sqrt(way_m + turn), 1e-5)
            dx, dy, dt = (rng.normal(size=3) * (sigma_m, sigma_m, sigma_rad)).tolist()
            said = Pose2(
                says.scale * step.x + says.ahead_mps * moving_s + dx,
                says.scale * step.y + dy,
                says.turn_scale * step.theta + math.radians(says.turn_dps) * moving_s + dt,
            )
            so_far, position_m2, turn_rad2 = sums[name]
            so_far, position_m2, turn_rad2 = so_far @ said, position_m2 + sigma_m**2, turn_rad2 + sigma_rad**2
            if i % every:
                sums[name] = so_far, position_m2, turn_rad2
                continue
            sums[name] = Pose2(), 0.0, 0.0
            sigmas = says.stated * math.sqrt(position_m2), says.stated * math.sqrt(turn_rad2)
            information = information_from_sigmas(sigmas[0], sigmas[0], sigmas[1])
            estimator.apply(name, Motion(t - every * DT_S, t, so_far, information))
        if i % max(5, every) == 0:
            told.judge(estimator.belief(t), pose)
    return told


@pytest.mark.parametrize("ahead_mps", [0.02, -0.05])
@pytest.mark.parametrize("legs", [SHUTTLE, [(6, 0.5, 0), (12, -0.5, 0)]], ids=["shuttle", "back"])
def test_a_drift_that_does_not_turn_back_with_the_robot_is_covered_and_told(legs: Legs, ahead_mps: float) -> None:
    told = drive(legs, {"wheels": WHEELS, "camera": Says(ahead_mps=ahead_mps)})

    assert told.worst < 5.0
    assert any("disagree by" in words for words in told.said["camera"])


def test_a_drift_is_told_as_one_after_the_robot_has_turned_back() -> None:
    told = drive(SHUTTLE, {"wheels": WHEELS, "camera": Says(ahead_mps=0.02)})

    assert any(words.startswith("wheels and camera disagree by 0.0") for words in told.said["camera"])


@pytest.mark.parametrize("seed", [3, 4])
def test_a_share_of_a_turn_on_the_spot_is_covered_and_told(seed: int) -> None:
    told = drive(SPIN, {"wheels": WHEELS, "camera": Says(turn_scale=1.05)}, seed=seed)

    assert told.worst < 5.0
    assert any("disagree by" in words for words in told.said["camera"])


def test_a_heading_that_drifts_beside_wheels_that_wander_is_covered() -> None:
    told = drive([(25, 2.0, 0)], {"wheels": WHEELS, "camera": Says(turn_dps=0.3)})

    assert max(told.heading) < 5.0


def test_two_of_three_that_may_be_wrong_alike_are_not_believed_alone() -> None:
    camera, laser = Says(scale=1.05), Says(scale=1.05, noise=(5e-3, 0.1))

    told = drive([(20, 0.5, 0)], {"wheels": WHEELS, "camera": camera, "laser": laser})

    assert told.worst < 5.0
    assert any("others agree with" in words and "covers both" in words for words in told.said["wheels"])


@pytest.mark.parametrize("every", [1, 20])
def test_a_difference_is_covered_before_it_is_sure(every: int) -> None:
    told = drive([(8, 0.5, 0)], {"wheels": WHEELS, "camera": Says(scale=0.9)}, every=every)

    assert len(told.position) > 4
    assert told.worst < 5.0


@pytest.mark.parametrize(
    "legs", [SPIN, SHUTTLE, [(6, 1.0, 0), (6, 0.05, 0), (3, 0.5, 0)]], ids=["spin", "shuttle", "slow"]
)
def test_honest_motions_are_not_named_on_the_spot_or_where_they_slow_down(legs: Legs) -> None:
    assert not drive(legs, {"wheels": WHEELS, "camera": Says()}).said


def test_a_third_motion_that_is_precise_says_more_of_the_belief_than_wheels_that_wander() -> None:
    laser = Says(noise=(5e-3, 0.1))

    two = drive([(15, 0.5, 0)], {"wheels": WHEELS, "camera": Says()})
    three = drive([(15, 0.5, 0)], {"wheels": WHEELS, "camera": Says(), "laser": laser})

    assert three.heading_sigma_rad < 0.7 * two.heading_sigma_rad


def test_what_is_told_of_one_kind_makes_no_other_last() -> None:
    estimator, rng, t = kalman(), np.random.default_rng(3), 0.0
    hidden = []
    for _ in range(600):
        for name, scale in (("wheels", 1.0), ("camera", 1.06)):
            x, y, turn = (rng.normal(size=3) * (2e-4, 2e-4, 1e-4)).tolist()
            step, information = Pose2(0.05 * scale + x, y, turn), information_from_sigmas(5e-3, 5e-3, 5e-4)
            estimator.apply(name, Motion(t, t + 0.1, step, information))
        t = round(t + 0.1, 6)
        parting = estimator._timeline.state_at(math.inf).diagnosis.parting
        hidden.append(parting.variances.drift)

    assert parting.told
    assert len(parting.lasts) == 1
    assert parting.variances.along == 0.0 or parting.variances.ahead < 1e-4
    assert hidden[-1] < 0.5 * hidden[99]  # nothing is told of turns, and less and less hides there


def test_a_clock_that_is_set_back_ends_no_comparison_of_motions() -> None:
    estimator, rng = kalman(), np.random.default_rng(3)
    for begin_s, camera in ((1000.0, 1.0), (0.0, 1.06)):
        for t in (begin_s + 0.1 * np.arange(200)).round(6).tolist():
            for name, scale in (("wheels", 1.0), ("camera", camera)):
                x, y, turn = (rng.normal(size=3) * (2e-4, 2e-4, 1e-4)).tolist()
                step, information = Pose2(0.05 * scale + x, y, turn), information_from_sigmas(5e-3, 5e-3, 5e-4)
                estimator.apply(name, Motion(t, t + 0.1, step, information))

    assert estimator._timeline.state_at(math.inf).diagnosis.parting.told


def test_a_heading_that_is_wrong_by_much_is_wrong_on_an_arc() -> None:
    sigma_rad, lever_m = 1.0, 10.0
    columns = (*UNAFFECTED[:9], 0.0, lever_m, 1.0, *UNAFFECTED[12:])

    covariance = lasting_covariance(columns, LastingVariances(drift=sigma_rad**2))

    off_m = lever_m * (1.0 - np.cos(np.random.default_rng(1).normal(size=200_000)))
    assert math.isclose(covariance[0, 0], float(np.mean(off_m**2)), rel_tol=0.02)
    assert math.isclose(covariance[1, 1], lever_m**2)


def test_what_two_tell_alike_is_logged_of_the_first_whatever_the_hashes(caplog: pytest.LogCaptureFixture) -> None:
    PartingLog().note(dict.fromkeys("hgfedcba", "they disagree"))

    assert caplog.messages == ["localizer 'h': they disagree"]
