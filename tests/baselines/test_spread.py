"""How the error of a step grows."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.geometry import Pose2
from trailmark_baselines.spread import Spread, random_walk, step_covariance

LENGTHS = st.floats(-5.0, 5.0)
VARIANCES = st.floats(1e-6, 1.0)


def chained(first: np.ndarray, second: np.ndarray, step: Pose2) -> np.ndarray:
    """Covariance of two steps in a row, of a world seen from the start (first order); the first one is straight."""
    carry = np.array([[1.0, 0.0, -step.y], [0.0, 1.0, step.x], [0.0, 0.0, 1.0]])
    return np.asarray(carry @ first @ carry.T + second)


@pytest.mark.parametrize("cuts", [2, 5, 100])
def test_a_straight_line_has_the_same_covariance_however_it_is_cut(cuts):
    length_m, spread = 3.0, Spread(0.03, 0.01, 0.02)
    whole = step_covariance(length_m, 0.0, spread)
    part = Spread(*(value / cuts for value in (spread.along_m2, spread.across_m2, spread.turn_rad2)))
    step = Pose2(length_m / cuts)

    total = np.zeros((3, 3))
    for _ in range(cuts):
        total = chained(total, step_covariance(step.x, 0.0, part), step)

    np.testing.assert_allclose(total, whole, rtol=1e-12)


def test_the_covariance_is_that_of_drives_whose_heading_walks_at_random():
    rng = np.random.default_rng(7)
    n_drives, n_steps, turn_rad2 = 20_000, 100, 0.01
    headings = np.cumsum(rng.normal(0.0, math.sqrt(turn_rad2 / n_steps), (n_drives, n_steps)), axis=1)
    ends = np.column_stack([np.cos(headings).mean(axis=1) * 2.0, np.sin(headings).mean(axis=1) * 2.0, headings[:, -1]])

    expected = step_covariance(2.0, 0.0, Spread(1e-12, 1e-12, turn_rad2))

    measured = np.cov(ends.T)
    np.testing.assert_allclose(measured[1:, 1:], expected[1:, 1:], rtol=0.05)


@given(LENGTHS, LENGTHS, VARIANCES, VARIANCES, VARIANCES)
def test_the_covariance_is_symmetric_and_positive(x, y, along, across, turn):
    covariance = step_covariance(x, y, Spread(along, across, turn))

    np.testing.assert_array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance)[0] > 0


@given(LENGTHS, st.floats(-3.0, 3.0))
def test_a_turned_step_has_the_turned_covariance(length_m, angle):
    spread = Spread(0.02, 0.02, 0.01)  # the same along and across, so that only the heading's part has a direction
    rotation = np.eye(3)
    rotation[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]

    turned = step_covariance(length_m * math.cos(angle), length_m * math.sin(angle), spread)

    expected = rotation @ step_covariance(length_m, 0.0, spread) @ rotation.T
    np.testing.assert_allclose(turned, expected, atol=1e-12)


def test_variances_of_random_walks_add_up():
    assert random_walk((0.1, 4.0), (0.2, -1.0)) == pytest.approx(0.04 + 0.04)
