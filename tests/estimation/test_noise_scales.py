"""The scale of covariances that is learned while running: who is taken at his word, and who is not."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from trailmark.estimates import Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman.noise_residuals import RecentMotions
from trailmark.estimation.kalman.noise_scales import NoiseScales
from trailmark.estimation.kalman.variance_components import MOST, both_sides
from trailmark.estimation.symmetric import to_matrix
from trailmark.geometry import Pose2, wrap_angle

from .conftest import kalman

DT_S, FIX_EVERY = 0.05, 5
SIGMAS = {
    "wheels": (2e-3, 1e-3, 4e-3),
    "camera": (6e-4, 6e-4, 6e-4),
    "laser": (0.02, 0.02, 0.01),
    "tags": (0.05, 0.05, 0.03),
}
MOTIONS = ("wheels", "camera")


@dataclass
class Drive:
    """What became of a drive: NEES per degree of freedom in its second half, the estimator, and its health."""

    nees: float
    estimator: Kalman
    health: set[str] = field(default_factory=set)


def drive(
    mix: Sequence[str],
    factors: Mapping[str, float] | None = None,
    *,
    duration_s: float = 80.0,
    outliers: float = 0.0,
    lasting: str = "",
    **config: object,
) -> Drive:
    """Drive on a winding way; `factors` multiply stated sigmas, the errors of `lasting` are the same in one place."""
    rng, estimator, pose = np.random.default_rng(0), kalman(**config), Pose2()
    squares: list[float] = []
    named: set[str] = set()
    for i in range(1, round(duration_s / DT_S) + 1):
        t = i * DT_S
        speed_mps = 0.5 * (1.0 + 0.3 * math.sin(2.0 * math.pi * t / 7.0))
        step = Pose2.exp(speed_mps * DT_S, 0.0, 0.4 * math.sin(2.0 * math.pi * t / 11.0) * DT_S)
        pose = pose @ step
        for name in mix:
            error = rng.normal(size=3) * SIGMAS[name]
            stated = (factors or {}).get(name, 1.0) * np.array(SIGMAS[name])
            information = information_from_sigmas(*stated.tolist())
            if name in MOTIONS:
                told = Pose2(step.x + error[0], step.y + error[1], step.theta + error[2])
                estimator.apply(name, Motion(t - DT_S, t, told, information))
            elif i % FIX_EVERY == (0 if name == "laser" else 2):
                if rng.uniform() < outliers:
                    error[:2] += rng.uniform(-3.0, 3.0, 2)
                if name == lasting:
                    wave = np.sin([pose.x / 1.5 + 1.0, pose.y / 1.2 + pose.x / 2.0, pose.x / 2.0])
                    error = wave * (0.07, 0.07, 0.03) + 0.1 * error
                told = Pose2(pose.x + error[0], pose.y + error[1], pose.theta + error[2])
                estimator.apply(name, Fix(t, told, information))
        if i % 10 == 0:
            belief = estimator.belief(t)
            assert belief.pose_map_base is not None
            assert belief.covariance is not None
            named |= set(belief.health)
            away = belief.pose_map_base.array() - pose.array()
            away[2] = wrap_angle(float(away[2]))
            squares.append(float(away @ np.linalg.solve(belief.covariance, away)) / 3.0)
    return Drive(float(np.mean(squares[len(squares) // 2 :])), estimator, named)


def tell_too_sure(estimator: Kalman, duration_s: float, *, begin_s: float = 0.0) -> None:
    """Tell motions of two that state a tenth of their sigmas, and where a robot stands once a second."""
    rng = np.random.default_rng(1)
    stated = information_from_sigmas(1e-3, 1e-3, 1e-3)
    for i in range(1, round(duration_s * 10.0) + 1):
        t = begin_s + 0.1 * i
        for name in MOTIONS:
            told = Pose2(*(rng.normal(size=3) * 0.01).tolist())
            estimator.apply(name, Motion(t - 0.1, t, told, stated))
        if i % 10 == 0:
            estimator.apply("laser", Fix(t, Pose2(), information_from_sigmas(0.01, 0.01, 0.01)))


@pytest.mark.parametrize("stamp_s", [1e6, math.inf, 60.0])
def test_an_estimate_that_is_refused_does_not_stop_the_learning(stamp_s: float) -> None:
    estimator = kalman()
    tell_too_sure(estimator, 1.0)
    refused = estimator.apply("laser", Fix(stamp_s, Pose2(1e9, 0.0, 0.0), information_from_sigmas(1.0, 1.0, 1.0)))
    tell_too_sure(estimator, 30.0, begin_s=1.0)

    assert refused.status == "refused"
    assert set(MOTIONS) <= set(estimator.noise_scales())


def test_of_a_motion_that_is_refused_no_scale_is_learned() -> None:
    rng, estimator = np.random.default_rng(1), kalman()
    stated = information_from_sigmas(*SIGMAS["camera"])
    for i in range(1, 1201):
        t = 0.05 * i
        told = Pose2(*(rng.normal(size=3) * SIGMAS["camera"]).tolist())
        honest = Motion(t - 0.05, t, told, stated)
        estimator.apply("camera", replace(honest, pose_since_now=Pose2(1e12, 0.0, 0.0)) if 10.0 < t < 30.0 else honest)
        if i % 5 == 0:
            dx, dy, turn = rng.normal(size=3) * SIGMAS["laser"]
            estimator.apply("laser", Fix(t, Pose2(dx, dy, turn), information_from_sigmas(*SIGMAS["laser"])))

    assert estimator.counters()["refused_too_fast"] > 300
    assert not estimator.noise_scales()


def test_scales_are_kept_and_learned_on_where_the_clock_went_back() -> None:
    estimator = kalman(time_jump="reset")
    tell_too_sure(estimator, 28.0, begin_s=600.0)
    before = dict(estimator.noise_scales())
    tell_too_sure(estimator, 1.0)
    at_once = dict(estimator.noise_scales())
    tell_too_sure(estimator, 20.0, begin_s=1.0)

    assert estimator.counters()["time_resets"] == 1
    assert set(before) == set(MOTIONS)
    assert at_once == before
    assert estimator.noise_scales()["wheels"] > 2.0 * before["wheels"]


@pytest.mark.parametrize(
    ("mix", "source", "factor"),
    [
        (("wheels", "camera", "laser"), "wheels", 0.1),
        (("wheels", "laser"), "laser", 0.1),
    ],
)
def test_a_source_that_states_a_tenth_of_its_sigmas_leaves_the_belief_consistent(
    mix: Sequence[str], source: str, factor: float
) -> None:
    done = drive(mix, {source: factor})

    assert 0.5 < done.nees < 2.0
    assert done.estimator.noise_scales()[source] == pytest.approx(1.0 / factor, rel=0.3)
    assert "as wrong as it says" in done.estimator.belief().health[source]


@pytest.mark.long
@pytest.mark.parametrize(
    ("mix", "source"),
    [
        (mix, source)
        for mix in (("wheels", "camera", "laser"), ("wheels", "camera", "laser", "tags"), ("wheels", "laser", "tags"))
        for source in mix
    ],
)
def test_a_source_that_is_too_sure_by_ten_leaves_the_belief_consistent(mix: Sequence[str], source: str) -> None:
    done = drive(mix, {source: 0.1}, duration_s=150.0)

    assert 0.5 < done.nees < 2.0


def test_sources_at_their_word_are_left_alone() -> None:
    done = drive(("wheels", "camera", "laser"), duration_s=60.0)

    assert done.estimator.noise_scales() == {}
    assert done.health == set()


def test_who_has_erred_by_less_than_it_says_stays_at_its_word() -> None:
    """What it allows for, slip or soft ground, may come."""
    done = drive(("wheels", "laser", "tags"), {"laser": 10.0}, duration_s=110.0)

    assert done.estimator.noise_scales() == {}
    assert done.nees < 2.0


def test_two_sources_never_make_each_other_small() -> None:
    done = drive(("wheels", "laser"), {"wheels": 10.0, "laser": 10.0}, duration_s=60.0)

    assert done.estimator.noise_scales() == {}


def test_errors_that_last_in_one_place_do_not_make_a_source_certain() -> None:
    done = drive(("wheels", "camera", "laser", "tags"), {"laser": 10.0}, lasting="laser", duration_s=100.0)

    assert done.estimator.noise_scales().get("laser", 1.0) >= 1.0
    assert done.nees < 2.0


def test_a_tenth_of_outliers_does_not_make_a_source_wrong_by_half_its_word() -> None:
    done = drive(("wheels", "camera", "laser"), outliers=0.1, duration_s=60.0)

    assert done.nees < 2.0
    assert done.estimator.noise_scales().get("laser", 1.0) < 2.0


@pytest.mark.long
def test_a_source_that_is_sure_by_ten_thousand_is_found_from_its_first_estimate_on() -> None:
    done = drive(("wheels", "camera", "laser"), {"laser": 1e-4}, duration_s=130.0)

    assert 1e3 < done.estimator.noise_scales()["laser"] <= MOST
    assert done.nees < 2.0


def test_scales_are_learned_only_where_the_config_allows_it() -> None:
    mix, factors = ("wheels", "laser"), {"laser": 0.1}

    allowed = drive(mix, factors, duration_s=30.0)
    forbidden = drive(mix, factors, duration_s=30.0, learn_scales=False)

    assert set(allowed.estimator.noise_scales()) == {"laser"}
    assert forbidden.estimator.noise_scales() == {}
    assert "sigma_percent.laser" not in forbidden.estimator.counters()


def tell_what_is_corrected(
    scales: NoiseScales,
    variances: Mapping[str, float],
    intervals_s: Mapping[str, float],
    *,
    since_s: float,
    until_s: float,
) -> None:
    """Tell motions of stated variances per second, where a filter corrects all the same way."""
    steps = [
        (round(i * dt_s, 6), source, dt_s)
        for source, dt_s in intervals_s.items()
        for i in range(round(since_s / dt_s) + 1, round(until_s / dt_s) + 1)
    ]
    for t, source, dt_s in sorted(steps):
        one = 1.0 / (variances[source] * dt_s)
        scales.believed_of_motion(source, Motion(t - dt_s, t, Pose2(), np.eye(3)), (one, 0.0, 0.0, one, 0.0, one))
        if scales.is_due(t):
            scales.compare(t, set(), (np.array([0.3 * t, 0.0, 0.0]), np.eye(3) * 1e-4 * t))


def test_of_a_localizer_that_tells_motion_and_poses_the_larger_scale_is_told() -> None:
    rng, estimator = np.random.default_rng(1), kalman()
    of_motion, of_fixes = information_from_sigmas(0.002, 0.002, 0.002), information_from_sigmas(0.02, 0.02, 0.02)
    for i in range(1, 401):
        t = 0.1 * i
        for name in ("laser", "wheels"):
            error = rng.normal(size=3) * 0.002 * (3.0 if name == "laser" else 1.0)
            estimator.apply(name, Motion(t - 0.1, t, Pose2(*error.tolist()), of_motion))
        if i % 3 == 0:
            told = Pose2(*(rng.normal(size=3) * 0.2).tolist())
            estimator.apply("laser", Fix(t, told, of_fixes))

    assert estimator.noise_scales()["laser"] == pytest.approx(10.0, rel=0.3)
    assert estimator.counters()["sigma_percent.laser"] > 700


def test_a_motion_that_went_silent_does_not_answer_for_another() -> None:
    scales, variances = NoiseScales(), {"camera": 1e-6, "wheels": 1e-4}
    tell_what_is_corrected(scales, variances, {"camera": 0.1, "wheels": 0.1}, since_s=0.0, until_s=10.0)
    tell_what_is_corrected(scales, variances, {"wheels": 0.1}, since_s=10.0, until_s=60.0)

    assert set(scales.scales()) == {"wheels"}


def test_the_surest_motion_is_that_of_the_least_variance_per_second() -> None:
    scales, variances = NoiseScales(), {"laser": 1e-4, "wheels": 4e-4}
    tell_what_is_corrected(scales, variances, {"laser": 0.1, "wheels": 0.02}, since_s=0.0, until_s=40.0)

    assert set(scales.scales()) == {"laser"}


def test_the_covariance_of_a_chain_is_that_of_its_motions_one_by_one() -> None:
    rng, track = np.random.default_rng(5), RecentMotions()
    pose, spread = Pose2(), np.zeros((3, 3))
    for i in range(12):
        step = Pose2(*(rng.normal(size=3) * (0.2, 0.1, 0.3)).tolist())
        root = rng.normal(size=(3, 3))
        covariance = root @ root.T + np.eye(3)
        a, b, c = np.linalg.inv(covariance)
        track.add((i * 0.1, (i + 1) * 0.1, step.x, step.y, step.theta, a[0], a[1], a[2], b[1], b[2], c[2]))
        cos, sin = math.cos(pose.theta), math.sin(pose.theta)
        longer = pose @ step
        before = np.array([[1.0, 0.0, pose.y - longer.y], [0.0, 1.0, longer.x - pose.x], [0.0, 0.0, 1.0]])
        turned = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        spread = before @ spread @ before.T + turned @ covariance @ turned.T
        pose = longer

    chain = track.chain()

    assert chain is not None
    found, found_spread = chain.between(0.0, 1.2)
    np.testing.assert_allclose(found[:2], pose.array()[:2], atol=1e-12)
    assert wrap_angle(float(found[2]) - pose.theta) == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(to_matrix(found_spread), spread, rtol=1e-9)


def test_a_chain_that_is_asked_for_now_and_then_is_that_of_all_its_motions_at_once() -> None:
    rng, often, once = np.random.default_rng(6), RecentMotions(), RecentMotions()
    for i in range(400):  # more than is kept
        step, information = rng.normal(size=3) * (0.1, 0.01, 0.1), rng.uniform(50.0, 90.0, size=3)
        row = (i * 0.1, (i + 1) * 0.1, *step.tolist(), information[0], 1.0, 2.0, information[1], 3.0, information[2])
        often.add(row)
        once.add(row)
        if i % 7 == 0 or i < 5:
            often.chain()

    chain, expected = often.chain(), once.chain()

    assert chain is not None
    assert expected is not None
    assert chain.between(30.0, 39.95) == expected.between(30.0, 39.95)


def test_both_sides_of_the_likelihood_equations_are_those_of_their_definition() -> None:
    rng = np.random.default_rng(7)
    for size in (1, 3):
        roots = rng.normal(size=(9, 2, size, size)) * np.array([1e-3, 2e-3, 1e-4])[:size, None]
        covariances = roots @ roots.transpose(0, 1, 3, 2)
        values = rng.normal(size=(9, size)) * 1e-9  # so small that none is clipped
        seen, expected, _ = both_sides(values, covariances)
        weights = np.linalg.inv(covariances.sum(axis=1))
        whole = np.einsum("ni,nij,nmjk,nkl,nl->m", values, weights, covariances, weights, values)
        np.testing.assert_allclose(seen / seen.sum(), whole / whole.sum(), rtol=1e-6)
        np.testing.assert_allclose(expected, np.einsum("nij,nmji->m", weights, covariances), rtol=1e-6)


def test_a_chain_along_a_corridor_does_not_know_its_place() -> None:
    track = RecentMotions()
    for i in range(3):  # what is measured lies at 45 deg to base
        track.add((float(i), i + 1.0, 0.1, 0.0, 0.0, 50.0, 50.0, 0.0, 50.0, 0.0, 100.0))

    chain = track.chain()

    assert chain is not None
    assert (chain.knows_place, chain.knows_heading) == (False, True)


def test_a_motion_that_knows_its_heading_alone_for_a_while_is_compared_as_before() -> None:
    rng, estimator = np.random.default_rng(1), kalman()
    whole, turn = information_from_sigmas(1e-3, 1e-3, 1e-3), np.diag([0.0, 0.0, 1e6])
    for i in range(1, 701):
        t = 0.1 * i
        for name in MOTIONS:
            information = turn if name == "camera" and 100 < i <= 300 else whole
            told = Pose2(*(rng.normal(size=3) * (0.01 if name == "wheels" else 0.001)).tolist())
            estimator.apply(name, Motion(t - 0.1, t, told, information))
        if i % 10 == 0:
            estimator.apply("laser", Fix(t, Pose2(), information_from_sigmas(0.01, 0.01, 0.01)))

    assert estimator.noise_scales()["wheels"] > 5.0
