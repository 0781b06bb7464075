"""Motions between poses on one map: the errors of matches cancel, and do not carry the belief away."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Lost, Motion, information_from_sigmas
from trailmark.estimation.kalman.agreement import Tolerance
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman.matched_motion import offsets_after, with_lasting_error, with_offsets
from trailmark.estimation.kalman.motions import MotionStep
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.symmetric import diagonal
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import Session

STEP = Pose2(0.1, 0.0, 0.02)
#: Standard deviations of a sharp match and of a vague one: rooms and doors in turn.
SHARP, VAGUE = np.array([0.002, 0.002, 0.001]), np.array([0.02, 0.02, 0.01])


def wander_of(is_matched: bool, seed: int, wheels_per_scan: int = 1) -> float:
    """Return the mean distance of the belief from the truth, wheels exact and matches noisy [m]."""
    rng = np.random.default_rng(seed)
    kalman = Kalman(KalmanConfig(learn_scales=False))
    kalman.start(Session(start_pose=Pose2()))
    truth, match, sigmas, away = Pose2(), Pose2(), SHARP, []
    forward_m, left_m, turn_rad = STEP.log()
    part = Pose2.exp(forward_m / wheels_per_scan, left_m / wheels_per_scan, turn_rad / wheels_per_scan)
    said_of_wheels = information_from_sigmas(*(np.array([0.006, 0.003, 0.006]) / math.sqrt(wheels_per_scan)))
    for index in range(1, 201):
        stamp_s = 0.2 * index
        for k in range(wheels_per_scan):
            ends_s = [0.2 * (index - 1 + share / wheels_per_scan) for share in (k, k + 1)]
            kalman.apply("wheels", Motion(*ends_s, part, said_of_wheels))
        truth, before, sigmas_before = truth @ STEP, match, sigmas
        sigmas = SHARP if rng.random() < 0.5 else VAGUE
        match = truth @ Pose2.from_array(sigmas * rng.standard_normal(3))
        information = information_from_sigmas(*np.hypot(sigmas, sigmas_before))
        step = before.between(match)
        kalman.apply("laser", Motion(stamp_s - 0.2, stamp_s, step, information, is_matched=is_matched))
        away.append(kalman.belief(stamp_s).pose_map_base.distance_to(truth))
    return float(np.mean(away))


def test_matches_of_changing_sharpness_do_not_carry_the_belief_off_their_map() -> None:
    seeds = range(6)

    independent, matched = ([wander_of(is_matched, seed) for seed in seeds] for is_matched in (False, True))

    assert np.mean(matched) < 0.6 * np.mean(independent)


def test_wheels_that_are_heard_more_often_change_little() -> None:
    once, often = (np.mean([wander_of(True, seed, n) for seed in range(3)]) for n in (1, 4))

    assert often == pytest.approx(once, rel=0.5)


def test_along_a_corridor_the_wheels_are_kept() -> None:
    kalman = Kalman(KalmanConfig())
    kalman.start(Session(start_pose=Pose2()))
    rng = np.random.default_rng(1)
    across = np.diag([0.0, 1.0 / 0.01**2, 1.0 / 0.005**2])
    for index in range(1, 101):
        ends_s = 0.2 * (index - 1), 0.2 * index
        kalman.apply("wheels", Motion(*ends_s, Pose2(0.1), information_from_sigmas(0.005, 0.005, 0.005)))
        match = Pose2(rng.normal() * 0.1, 0.0, 0.0)
        kalman.apply("laser", Motion(*ends_s, match, across, is_matched=True))

    assert kalman.belief(20.0).pose_map_base.x == pytest.approx(10.0, abs=0.005)


def test_a_scan_that_is_lost_begins_a_new_map() -> None:
    """What the old map said of the belief is forgotten with it: an error there is not corrected on the new one."""
    kalman = Kalman(KalmanConfig(gate="off"))
    kalman.start(Session(start_pose=Pose2()))
    sure, unsure = information_from_sigmas(0.002, 0.002, 0.002), information_from_sigmas(0.01, 0.01, 0.01)
    for index, off_m in enumerate((0.01, None, 0.0), start=1):
        ends_s = 0.2 * (index - 1), 0.2 * index
        kalman.apply("wheels", Motion(*ends_s, Pose2(0.1), sure))
        if off_m is None:
            kalman.apply("laser", Lost(ends_s[1], "people"))
        else:
            kalman.apply("laser", Motion(*ends_s, Pose2(0.1, off_m, 0.0), unsure, is_matched=True))
    held = kalman.belief(0.4).pose_map_base.y

    assert 0.0 < held < 0.001
    assert kalman.belief(0.6).pose_map_base.y == pytest.approx(held, abs=1e-6)


def test_only_what_a_match_explains_is_remembered() -> None:
    stated = [
        ("laser", MotionStep(1.1, 0.0, 0.0, diagonal(1e-4, 1e-4, 1e-4), None, Twist2(), matched_share=1.0)),
        ("wheels", MotionStep(0.1, 0.0, 0.0, diagonal(1e-6, 1e-6, 1e-6), None, Twist2())),
    ]

    offsets = offsets_after(stated, stated[1][1], {})
    steps = with_offsets(stated, [step for _, step in stated], offsets)

    assert offsets["laser"] == pytest.approx((0.04, 0.0, 0.0), rel=1e-6)  # four standard deviations
    assert steps[0].x == pytest.approx(1.14)
    assert steps[1] is stated[1][1]


def test_who_is_alone_or_says_nothing_remembers_nothing() -> None:
    step = MotionStep(0.1, 0.0, 0.0, diagonal(1e-4, 1e-4, 1e-4), None, Twist2(), matched_share=1.0)
    plain = MotionStep(0.1, 0.0, 0.0, diagonal(1e-4, 1e-4, 1e-4), None, Twist2())
    before = {"laser": (0.01, 0.0, 0.0)}

    assert not offsets_after([("laser", step)], step, before)
    assert not offsets_after([("gyro", plain), ("wheels", plain)], plain, before)


def worst_sigma_of(scale: float, turn_deg_per_s: float, seed: int) -> float:
    """Return how far off a belief is in a minute whose laser has a map that walks off, in its own sigmas."""
    rng, kalman = np.random.default_rng(seed), Kalman(KalmanConfig())
    kalman.start(Session(start_pose=Pose2()))
    wheels, laser = np.array([0.003, 0.002, 0.002]), np.array([0.01, 0.01, 0.004])
    truth, walked, match, worst = Pose2(), Pose2(), Pose2(), 0.0
    for index in range(1, 301):
        ends_s, step = (0.2 * (index - 1), 0.2 * index), Pose2(0.1, 0.0, 0.02 * math.sin(index / 20))
        said = step @ Pose2.from_array(wheels * rng.standard_normal(3))
        kalman.apply("wheels", Motion(*ends_s, said, information_from_sigmas(*wheels)))
        truth = truth @ step
        walked = walked @ Pose2(scale * step.x, 0.0, step.theta + math.radians(turn_deg_per_s) * 0.2)
        before, match = match, walked @ Pose2.from_array(laser / math.sqrt(2) * rng.standard_normal(3))
        kalman.apply("laser", Motion(*ends_s, before.between(match), information_from_sigmas(*laser), is_matched=True))
        if index % 5 == 0:
            belief = kalman.belief(ends_s[1])
            assert belief.pose_map_base is not None
            assert belief.covariance is not None
            away = np.array([belief.pose_map_base.x - truth.x, belief.pose_map_base.y - truth.y])
            worst = max(worst, math.sqrt(away @ np.linalg.solve(belief.covariance[:2, :2], away)))
    return worst


@pytest.mark.parametrize(("scale", "turn_deg_per_s"), [(1.0, 0.0), (1.01, 0.0), (1.0, 0.2), (1.01, 0.2)])
def test_a_belief_that_follows_a_map_which_walks_off_says_so(scale: float, turn_deg_per_s: float) -> None:
    assert max(worst_sigma_of(scale, turn_deg_per_s, seed) for seed in range(2)) < 4.0


def test_a_map_that_walks_off_adds_only_what_it_can_draw() -> None:
    tolerance, offsets = Tolerance(0.03, math.radians(0.3)), {"laser": (0.0, 0.0, 0.0)}
    across = (0.0, 0.0, 0.0, 1e4, 0.0, 1e4)
    corridor = MotionStep(0.1, 0.0, 0.0, None, across, Twist2(), matched_share=1.0)
    drives = MotionStep(0.1, 0.0, 0.0, diagonal(1e-5, 1e-5, 1e-5), None, Twist2())
    stands = MotionStep(0.0, 0.0, 0.0, diagonal(1e-12, 1e-12, 1e-12), None, Twist2())

    def added(fused: MotionStep, known: dict[str, tuple[float, float, float]] = offsets) -> list[float]:
        step = with_lasting_error(fused, [("laser", corridor)], known, 0.2, tolerance)
        assert step.covariance is not None
        assert fused.covariance is not None
        return [now - before for now, before in zip(step.covariance, fused.covariance)]

    # An error that lasts 2 s is shared by steps of 0.2 s with 10 before and 10 behind.
    assert added(drives) == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.0, 20.0 * math.radians(0.06) ** 2], rel=1e-6)
    assert math.sqrt(added(stands)[5]) < 1e-8
    assert added(drives, {}) == [0.0] * 6
