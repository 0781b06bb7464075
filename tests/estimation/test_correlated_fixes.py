"""Absolute poses whose errors last: what they are worth, and how it is found out that they do."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from trailmark.errors import ShapeError
from trailmark.estimates import Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.correlated_fixes import innovation_moments, share_of_news
from trailmark.estimation.kalman.correlation_times import correlation_of
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import SourceTreatment
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Session

from .conftest import kalman

SIGMAS, WHEELS = np.array([0.05, 0.05, 0.02]), np.array([5e-3, 2e-3, 3e-3])
FIX, STEP = information_from_sigmas(*SIGMAS.tolist()), information_from_sigmas(*WHEELS.tolist())


@dataclass
class Drive:
    """What became of a drive: squared errors and NEES per degree of freedom of its second half, and the estimator."""

    square_m2: float
    nees: float
    estimator: Kalman


@cache
def drive(
    correlation_s: float,
    *,
    declared_s: float | None = None,
    seed: int = 0,
    stated: float = 1.0,
    slip: float = 1.0,
    learns: bool = True,
) -> Drive:
    """Drive for 120 s on a winding way with wheels, and poses every 0.4 s whose errors are an AR(1) process."""
    rng, estimator, pose = np.random.default_rng(seed), kalman(learn_correlations=learns), Pose2()
    r = math.exp(-0.4 / correlation_s) if correlation_s else 0.0
    error = rng.normal(size=3) * SIGMAS
    squares, normalized = [], []
    for i in range(1, 1201):
        t = 0.1 * i
        speed_mps = 0.5 * (1.0 + 0.3 * math.sin(2.0 * math.pi * t / 7.0))
        step = Pose2.exp(speed_mps * 0.1, 0.0, 0.04 * math.sin(2.0 * math.pi * t / 11.0))
        pose = pose @ step
        dx, dy, turn = slip * rng.normal(size=3) * WHEELS
        estimator.apply("wheels", Motion(t - 0.1, t, Pose2(step.x + dx, step.y + dy, step.theta + turn), STEP))
        if i % 4 == 0:
            error = r * error + math.sqrt(1.0 - r * r) * rng.normal(size=3) * SIGMAS
            seen = Pose2(pose.x + error[0], pose.y + error[1], pose.theta + error[2])
            estimator.apply("poses", Fix(t, seen, FIX / stated**2, correlation_s=declared_s))
        if i > 600 and i % 5 == 0:
            belief = estimator.belief(t)
            assert belief.pose_map_base is not None
            away = belief.pose_map_base.array() - pose.array()
            away[2] = wrap_angle(float(away[2]))
            squares.append(float(away[:2] @ away[:2]))
            normalized.append(float(away @ np.linalg.solve(belief.covariance, away)) / 3.0)
    return Drive(float(np.mean(squares)), float(np.mean(normalized)), estimator)


def stand(estimator: Kalman, n: int, *, backwards: bool = False) -> float:
    """Tell of one stand n poses, 0.1 s apart, and return the information on x beyond that of the start [1/m^2]."""
    estimator.start(Session(start_pose=Pose2()))
    still = information_from_sigmas(1e-6, 1e-6, 1e-4)
    estimator.apply("wheels", Motion(0.0, 2.0, Pose2(), still))
    for i in reversed(range(n)) if backwards else range(n):
        estimator.apply("poses", Fix(0.1 * (i + 1), Pose2(1e-3 * i, 0.0, 0.0), FIX, correlation_s=0.25))
    covariance = estimator.belief(2.0).covariance
    assert covariance is not None
    return float(np.linalg.inv(covariance)[0, 0]) - 1.0 / 10.0**2


@pytest.mark.parametrize("n", [1, 2, 5, 12])
def test_n_correlated_looks_tell_what_the_best_mean_of_them_tells(n: int) -> None:
    gaps = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    correlations = np.exp(-0.1 * gaps / 0.25)
    expected = float(np.linalg.inv(correlations).sum()) / SIGMAS[0] ** 2

    told = stand(kalman(start_sigma_m=10.0, start_sigma_deg=100.0), n)

    assert told == pytest.approx(expected, rel=2e-2)


def test_what_is_new_does_not_depend_on_the_order_of_arrival() -> None:
    estimators = [kalman(start_sigma_m=10.0), kalman(start_sigma_m=10.0)]
    told = [stand(estimator, 5, backwards=is_late) for estimator, is_late in zip(estimators, (False, True))]
    beliefs = [estimator.belief(2.0) for estimator in estimators]

    assert told[0] == pytest.approx(told[1], rel=1e-9)
    np.testing.assert_allclose(beliefs[0].pose_map_base.array(), beliefs[1].pose_map_base.array(), atol=1e-12)


def test_the_unscented_filter_takes_correlated_looks_alike() -> None:
    told = [stand(kalman(start_sigma_m=10.0, filter=name), 5) for name in ("ekf", "ukf")]

    assert told[0] == pytest.approx(told[1], rel=1e-3)


def test_a_look_counts_for_more_than_its_news_where_the_belief_was_lost() -> None:
    shares = share_of_news(0.1, 10.0, np.array([0.01, 2.0, 1e12]))

    np.testing.assert_allclose(shares[0], math.tanh(0.005))
    np.testing.assert_allclose(shares[1:], [0.5, 1.0])  # after it, the variance is that of a look


@pytest.mark.parametrize("r", [0.0, 0.6, 0.95])
@pytest.mark.parametrize(("gain", "lost"), [(0.02, 4e-4), (0.4, 0.3)])
def test_moments_of_innovations_are_those_of_the_steady_state(r: float, gain: float, lost: float) -> None:
    rng = np.random.default_rng(4)
    n = 200_000
    news, steps = rng.normal(size=n) * math.sqrt(1.0 - r * r), rng.normal(size=n) * math.sqrt(lost)
    error, away = rng.normal(), 0.0
    innovations = np.empty(n)
    for i, (new, step) in enumerate(zip(news.tolist(), steps.tolist())):
        error = r * error + new
        away += step
        innovations[i] = error - away
        away += gain * (error - away)
    told = innovation_moments(r, gain, lost)

    assert np.mean(innovations**2) == pytest.approx(told[0] + told[2], abs=0.05)
    assert np.mean(innovations[1:] * innovations[:-1]) == pytest.approx(told[1] + told[3], abs=0.05)


@pytest.mark.parametrize("r", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("size", [0.3, 1.0])
@pytest.mark.parametrize(("gain", "lost"), [(0.02, 4e-4), (0.2, 0.05)])
def test_moments_tell_correlation_whatever_the_size_of_the_errors(
    r: float, size: float, gain: float, lost: float
) -> None:
    variance, covariance, from_motion, with_next = innovation_moments(r, gain, lost)

    found = correlation_of(size * variance + from_motion, size * covariance + with_next, gain, lost)

    assert found == pytest.approx(r, abs=0.03)


@pytest.mark.parametrize("correlation_s", [1.0, 3.0])
def test_lasting_errors_leave_the_belief_consistent_and_blame_no_wheels(correlation_s: float) -> None:
    declared = [drive(correlation_s, declared_s=correlation_s, seed=seed) for seed in range(2)]
    learned = [drive(correlation_s, seed=seed) for seed in range(2)]

    assert 0.5 < np.mean([one.nees for one in declared]) < 2.0
    assert 0.5 < np.mean([one.nees for one in learned]) < 2.0
    rms = [math.sqrt(np.mean([one.square_m2 for one in drives])) for drives in (learned, declared)]
    assert rms[0] < 1.1 * rms[1]
    assert all(not one.estimator.noise_scales() for one in (*declared, *learned))
    assert all(one.estimator.correlation_times()["poses"] > 0.5 * correlation_s for one in learned)
    assert learned[0].estimator.counters()["correlation_ms.poses"] > 500 * correlation_s


def test_fresh_errors_are_taken_for_lasting_ones_of_nobody() -> None:
    assert not drive(0.0).estimator.correlation_times()
    assert not drive(0.0, stated=3.0).estimator.correlation_times()  # better than it says
    assert not drive(0.0, slip=4.0).estimator.correlation_times()  # the wheels are worse than they say


def test_a_declared_or_configured_time_is_taken_instead_of_what_is_learned() -> None:
    assert not drive(3.0, declared_s=0.0).estimator.correlation_times()
    assert not drive(3.0, learns=False).estimator.correlation_times()
    configured = kalman(
        start_sigma_m=10.0, start_sigma_deg=100.0, sources={"poses": SourceTreatment(correlation_s=0.0)}
    )

    assert stand(configured, 5) == pytest.approx(5.0 / SIGMAS[0] ** 2, rel=2e-2)


def test_times_are_kept_where_the_clock_went_back() -> None:
    estimator = drive(3.0).estimator
    before = estimator.correlation_times()["poses"]
    for i in range(10):
        estimator.apply("wheels", Motion(-1000.0 + 0.1 * i, -999.9 + 0.1 * i, Pose2(), STEP))

    assert estimator.counters()["time_resets"] == 1
    assert estimator.correlation_times() == {"poses": before}


@pytest.mark.parametrize("wrong_s", [-1.0, math.nan, math.inf])
def test_a_correlation_time_that_cannot_be_is_refused(wrong_s: float) -> None:
    with pytest.raises(ShapeError, match="correlation time"):
        Fix(0.0, Pose2(), FIX, correlation_s=wrong_s)
