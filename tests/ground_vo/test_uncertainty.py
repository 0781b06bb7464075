"""How far to trust a motion."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark_ground_vo.uncertainty import (
    drift_information,
    response_covariance,
    turn_information,
    whole_pixel_information,
)


def bowl(curve_u, curve_v, n_pixels=768):
    i, j = np.meshgrid(np.arange(-8, 9), np.arange(-8, 9))
    plane = 5.0 * n_pixels * (1.0 + curve_u * np.abs(i) + curve_v * np.abs(j))
    return np.rint(plane)[None].astype(np.int32)


def test_a_sharp_minimum_is_as_good_as_rounding():
    errors = bowl(1.0, 1.0)

    covariance = response_covariance(errors, int(errors.min()), 768)

    np.testing.assert_allclose(covariance, np.eye(2) / 12, atol=1e-6)


def test_along_a_grain_the_shift_is_uncertain():
    errors = bowl(1.0, 0.005)

    covariance = response_covariance(errors, int(errors.min()), 768)

    assert covariance[0, 0] == pytest.approx(1 / 12, rel=0.01)
    assert covariance[1, 1] > 10.0


def test_a_slanted_grain_couples_both_directions():
    errors = bowl(1.0, 0.0)[0]
    slanted = np.stack([np.roll(row, j - 8) for j, row in enumerate(errors)])[None]

    covariance = response_covariance(slanted, int(slanted.min()), 768)

    assert covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]) > 0.8


def test_a_picture_without_errors_does_not_divide_by_zero():
    assert np.all(np.isfinite(response_covariance(np.zeros((3, 5, 5), np.int32), 0, 768)))


def test_two_viewpoints_give_the_mean_shift_and_the_turn_over_their_distance():
    covariance = np.diag([0.04, 0.08])

    information = whole_pixel_information(covariance, covariance, 128.0, 1.0)

    expected = [0.02, 0.04, 2 * 0.04 / 128**2]
    np.testing.assert_allclose(np.linalg.inv(information), np.diag(expected), rtol=1e-9, atol=1e-15)


def test_drift_grows_with_the_share_of_replaced_pixels_and_never_vanishes():
    alignment = np.diag([100.0, 100.0, 1e6])

    half = drift_information(alignment, 0.5, 2.0)
    none = drift_information(alignment, 0.0, 2.0)

    np.testing.assert_allclose(half, alignment)
    assert np.all(np.isfinite(none))
    assert none[0, 0] > half[0, 0]


def test_a_turn_that_is_known_with_the_shift_alone_is_not_known():
    covariance = np.array([[4.0, 0.0, 0.2], [0.0, 1.0, 0.0], [0.2, 0.0, 0.04]])

    assert turn_information(np.linalg.inv(covariance)) == pytest.approx(1 / 0.04)
    assert turn_information(np.diag([0.0, 1.0, 25.0])) == pytest.approx(25.0)
    along = np.array([1.0, 0.0, 1.0])
    assert turn_information(np.outer(along, along)) == pytest.approx(0.0)
