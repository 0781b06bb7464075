"""Sums of differences that share poses and motion are as uncertain as they scatter."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimation.kalman.overlapping_differences import WeightedDifferences, variance_of_sum

POSE = np.array([[4e-4, 1e-4, 2e-5], [1e-4, 3e-4, -1e-5], [2e-5, -1e-5, 1e-4]])
PER_S = np.array([[2e-4, -5e-5, 1e-5], [-5e-5, 1e-4, 0.0], [1e-5, 0.0, 5e-5]])
#: Stamps of the poses that are compared: neighbours, and some over a long way.
PAIRS = [*((i, i + 1) for i in range(20)), *((i, i + 8) for i in range(0, 12, 2))]


@pytest.mark.parametrize("correlation_s", [0.0, 1.5])
def test_a_sum_of_differences_is_as_uncertain_as_it_scatters(correlation_s: float) -> None:
    rng = np.random.default_rng(3)
    r, n_runs, weights = (
        math.exp(-0.5 / correlation_s) if correlation_s else 0.0,
        4000,
        rng.normal(size=(len(PAIRS), 3)),
    )
    new = rng.normal(size=(21, n_runs, 3)) @ np.linalg.cholesky(POSE).T
    errors = [new[0]]
    for each in new[1:]:
        errors.append(r * errors[-1] + math.sqrt(1.0 - r * r) * each)
    steps = rng.normal(size=(20, n_runs, 3)) @ np.linalg.cholesky(0.5 * PER_S).T
    drift = np.concatenate([np.zeros((1, n_runs, 3)), np.cumsum(steps, axis=0)])
    sums = sum(
        (errors[b] - errors[a] - (drift[b] - drift[a])) @ weight for (a, b), weight in zip(PAIRS, weights, strict=True)
    )

    since_s, stamp_s = 0.5 * np.array(PAIRS, dtype=np.float64).T
    covariances = np.array([[POSE, POSE, (b - a) * 0.5 * PER_S] for a, b in PAIRS])
    stated = variance_of_sum([[WeightedDifferences(since_s, stamp_s, weights, covariances)]], correlation_s)

    assert stated == pytest.approx(float(np.var(sums)), rel=0.1)


def test_what_two_motions_are_compared_with_errs_once() -> None:
    one = WeightedDifferences(
        np.array([0.0]), np.array([1.0]), np.ones((1, 3)), np.array([[np.eye(3), np.eye(3), np.zeros((3, 3))]])
    )

    assert variance_of_sum([[one]], 0.0) == pytest.approx(6.0)
    assert variance_of_sum([[one], [one]], 0.0) == pytest.approx(24.0)
