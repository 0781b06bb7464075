"""The two filters: the update against filterpy's own, and the unscented one against the extended one."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter

from trailmark.errors import ShapeError
from trailmark.estimates import Fix, information_from_sigmas
from trailmark.estimation.kalman.correction import Filter
from trailmark.estimation.kalman.ekf import Ekf, PredictedMotion
from trailmark.estimation.kalman.innovation import Innovation, nis_of
from trailmark.estimation.kalman.measurements import fix_measurement
from trailmark.estimation.kalman.motions import MotionStep
from trailmark.estimation.kalman.trust import Trust
from trailmark.estimation.kalman.ukf import Ukf
from trailmark.estimation.kalman.weighing import nis_between
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.symmetric import diagonal
from trailmark.geometry import Pose2, Twist2

TRUST = Trust.of(KalmanConfig(), "any")


def covariance(rng: np.random.Generator, n: int) -> np.ndarray:
    rows = rng.normal(size=(n, n)) * 0.1
    return rows @ rows.T + 1e-4 * np.eye(n)


def test_filterpy_is_imported_for_the_unscented_filter_alone() -> None:
    code = (
        "import sys; from trailmark.estimation.kalman.estimator import Kalman;"
        "from trailmark.estimation.kalman_config import KalmanConfig; from trailmark.interfaces import Session;"
        "Kalman(KalmanConfig()).start(Session()); assert 'filterpy' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_scipy_is_not_imported_for_usual_estimates() -> None:
    code = (
        "import sys; from trailmark.estimation.kalman.estimator import Kalman;"
        "from trailmark.estimates import Fix, Motion, information_from_sigmas; from trailmark.geometry import Pose2;"
        "from trailmark.estimation.kalman_config import KalmanConfig; from trailmark.interfaces import Session;"
        "estimator = Kalman(KalmanConfig()); estimator.start(Session(start_pose=Pose2()));"
        "good = information_from_sigmas(1e-3, 1e-3, 1e-3); step = Pose2(0.1);"
        "[estimator.apply(one, Motion(0.1 * i, 0.1 * (i + 1), step, good)) for i in range(80) for one in ('a', 'b')];"
        "[estimator.apply('map', Fix(0.5 * i, Pose2(0.5 * i), good)) for i in range(1, 16)];"
        "assert estimator.belief().pose_map_base.x > 7.0; assert 'scipy' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("n", [3, 5])
def test_the_prediction_is_that_of_filterpy_to_the_last_bit(n: int) -> None:
    rng = np.random.default_rng(n)
    prior, jacobian, noise = covariance(rng, n), rng.normal(size=(n, n)), covariance(rng, n)
    theirs = ExtendedKalmanFilter(n, 3)
    theirs.P, theirs.F, theirs.Q = prior.copy(), jacobian, noise
    theirs.predict()
    moved = rng.normal(size=n)

    x, predicted = Ekf(n).predict(np.zeros(n), prior, PredictedMotion(moved, jacobian, noise, (0.0, 0.0, 0.0)))

    assert x.tolist() == moved.tolist()
    assert predicted.tolist() == theirs.P.tolist()


@pytest.mark.parametrize("k", [1, 2, 3])
@pytest.mark.parametrize("n", [3, 5])
def test_the_update_is_that_of_filterpy(k: int, n: int) -> None:
    rng = np.random.default_rng(10 * k + n)
    x, prior = rng.normal(size=n), covariance(rng, n)
    innovation, jacobian = rng.normal(size=k), rng.normal(size=(k, n)) * 5.0
    theirs = ExtendedKalmanFilter(n, k)
    theirs.x, theirs.P = x.copy(), prior.copy()
    theirs.update(innovation, lambda _: jacobian, lambda _: np.zeros(k), R=np.eye(k))

    ours, posterior = Ekf(n).update(x, prior, Innovation(innovation, jacobian, prior), NotAsked())

    np.testing.assert_allclose(ours, theirs.x, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(posterior, theirs.P, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_step_of_one_axis_is_tested_as_one_of_many_is(axis: int) -> None:
    rng = np.random.default_rng(axis)
    alone, nearly = np.zeros(3), np.full(3, 1e-60)  # the latter says nothing of two axes, and is no lone axis
    alone[axis] = nearly[axis] = 400.0
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = covariance(rng, 3).tolist()
    other = MotionStep(0.1, 0.2, 0.3, (xx, xy, xt, yy, yt, tt), None, Twist2())

    def nis_of_step(information: np.ndarray) -> float:
        step = MotionStep(0.4, -0.1, 0.1, None, diagonal(*information.tolist()), Twist2())
        return nis_between(step, other)[0]

    assert nis_between(MotionStep(0.4, -0.1, 0.1, None, diagonal(*alone.tolist()), Twist2()), other)[1] == 1
    assert nis_of_step(alone) == pytest.approx(nis_of_step(nearly), rel=1e-12)


class NotAsked:
    def innovation(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        raise AssertionError("the extended filter has its innovation")


@pytest.mark.parametrize("k", [1, 2, 3, 4])
def test_nis_is_the_squared_innovation_in_its_own_covariance(k: int) -> None:
    rng = np.random.default_rng(k)
    innovation, jacobian, prior = rng.normal(size=k), rng.normal(size=(k, 3)), covariance(rng, 3)
    expected = innovation @ np.linalg.inv(jacobian @ prior @ jacobian.T + np.eye(k)) @ innovation

    assert Innovation(innovation, jacobian, prior).nis == pytest.approx(expected)
    assert nis_of(innovation, jacobian, prior) == pytest.approx(expected)


def test_shapes_that_numpy_would_broadcast_are_refused() -> None:
    with pytest.raises(ShapeError, match="do not fit"):
        Innovation(np.zeros((3, 1)), np.eye(3), np.eye(3))
    with pytest.raises(ShapeError, match="do not fit"):
        Innovation(np.zeros(2), np.eye(3), np.eye(3))


def test_a_posterior_stays_positive_over_eighteen_orders_of_certainty() -> None:
    kalman, x, prior = Ekf(3), np.zeros(3), 1e6 * np.eye(3)
    for sigma in (1e-6, 1e3, 1e-6, 1e-3):
        fix = fix_measurement(
            "any",
            Fix(0.0, Pose2(), information_from_sigmas(sigma, sigma, 1.0)),
            (sigma**-2, 0, 0, sigma**-2, 0, 1.0),
            TRUST,
        )
        x, prior = kalman.update(x, prior, Innovation(*fix.innovation(x), prior), fix)

        assert np.linalg.eigvalsh(prior)[0] > 0.0
        np.testing.assert_allclose(prior, prior.T, rtol=1e-9, atol=1e-20)


def turned(x: np.ndarray, step: tuple[float, float, float]) -> PredictedMotion:
    cos, sin = math.cos(x[2]), math.sin(x[2])
    dx, dy = cos * step[0] - sin * step[1], sin * step[0] + cos * step[1]
    jacobian = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
    return PredictedMotion(x + np.array([dx, dy, step[2]]), jacobian, 1e-6 * np.eye(3), step)


@pytest.mark.parametrize("heading", [0.3, math.pi - 1e-3, -math.pi + 1e-3])
def test_both_filters_agree_where_the_belief_is_narrow(heading: float) -> None:
    x, prior = np.array([1.0, 2.0, heading]), np.diag([1e-4, 2e-4, 1e-6])
    fix = fix_measurement(
        "any", Fix(0.0, Pose2(1.11, 2.0, heading + 0.003), np.eye(3)), (1e4, 0, 0, 1e4, 0, 1e6), TRUST
    )
    results = []
    for kalman in (Ekf(3), Ukf(3)):
        moved, spread = kalman.predict(x, prior, turned(x, (0.1, 0.0, 0.002)))
        moved[2] = math.remainder(moved[2], math.tau)
        results.append(kalman.update(moved, spread, Innovation(*fix.innovation(moved), spread), fix))

    (x_extended, spread_extended), (x_unscented, spread_unscented) = results
    difference = x_unscented - x_extended
    difference[2] = math.remainder(difference[2], math.tau)
    np.testing.assert_allclose(difference, 0.0, atol=1e-7)
    np.testing.assert_allclose(spread_unscented, spread_extended, rtol=1e-3, atol=1e-9)


def test_an_unscented_way_with_an_uncertain_heading_is_as_short_as_its_true_mean() -> None:
    sigma = 0.5
    x, prior = np.zeros(3), np.diag([1e-9, 1e-9, sigma**2])
    kalman: Filter = Ukf(3)

    moved, spread = kalman.predict(x, prior, turned(x, (10.0, 0.0, 0.0)))

    assert moved[0] == pytest.approx(10.0 * math.exp(-(sigma**2) / 2.0), rel=0.01)  # E cos of a normal angle
    true_variance = 50.0 * (1.0 + math.exp(-2.0 * sigma**2)) - 100.0 * math.exp(-(sigma**2))
    assert 0.5 * true_variance < spread[0, 0] < 1.5 * true_variance  # the extended filter says 0


def test_what_the_unscented_filter_is_given_may_be_singular() -> None:
    x, prior = np.zeros(3), np.diag([1e-4, 1e-4, 0.0])

    moved, spread = Ukf(3).predict(x, prior, turned(x, (0.1, 0.0, 0.0)))

    assert np.isfinite(moved).all()
    assert np.isfinite(spread).all()
