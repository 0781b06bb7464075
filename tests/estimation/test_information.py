"""What an information matrix says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.errors import ShapeError
from trailmark.estimates import information_along, information_from_sigmas
from trailmark.estimation.information import checked_covariance, checked_information, measured_directions
from trailmark.estimation.symmetric import Sym3, to_matrix


def checked(matrix: np.ndarray) -> Sym3:
    answer = checked_information(matrix)
    assert not isinstance(answer, str), answer
    return answer


@pytest.mark.parametrize(
    ("matrix", "reason"),
    [
        (np.diag([1.0, math.nan, 1.0]), "not finite"),
        (np.diag([1.0, math.inf, 1.0]), "not finite"),
        (np.diag([1.0, -1.0, 1.0]), "negative diagonal"),
        (np.array([[1.0, 0.1, 0], [0.2, 1, 0], [0, 0, 1]]), "not symmetric: 0.1 against 0.2"),
        (np.array([[1.0, 2.0, 0], [2.0, 1, 0], [0, 0, 1]]), "negative in a direction"),
        (np.array([[0.0, 0.5, 0], [0.5, 1, 0], [0, 0, 1]]), "negative in a direction"),
    ],
)
def test_what_cannot_be_information_is_named(matrix: np.ndarray, reason: str) -> None:
    answer = checked_information(matrix)

    assert isinstance(answer, str)
    assert reason in answer


def test_rounding_is_no_asymmetry() -> None:
    matrix = np.array([[1.0, 0.1, 0], [0.1 * (1 + 1e-12), 1, 0], [0, 0, 1]])

    assert checked(matrix)[1] == pytest.approx(0.1)


def test_a_full_measurement_replaces_everything() -> None:
    measured = measured_directions(checked(information_from_sigmas(0.1, 0.2, 0.3)))

    assert measured.rank == 3
    assert measured.gain is None
    np.testing.assert_allclose(to_matrix(measured.covariance), np.diag([0.01, 0.04, 0.09]))


def test_an_axis_that_was_not_measured_is_kept() -> None:
    measured = measured_directions(checked(information_from_sigmas(0.1, 0.2, math.inf)))

    assert measured.rank == 2
    np.testing.assert_allclose(measured.gain, np.diag([1.0, 1.0, 0.0]), atol=1e-12)
    np.testing.assert_allclose(to_matrix(measured.covariance), np.diag([0.01, 0.04, 0.0]), atol=1e-15)


def test_axes_by_themselves_are_measured_as_the_general_way_measures_them() -> None:
    axes = measured_directions((4.0, 0.0, 0.0, 0.0, 0.0, 900.0))
    nearly = measured_directions((4.0, 0.0, 1e-13, 0.0, 0.0, 900.0))  # not diagonal: eigenvalues

    assert axes.rank == nearly.rank == 2
    np.testing.assert_allclose(axes.gain, nearly.gain, atol=1e-12)
    np.testing.assert_allclose(axes.covariance, nearly.covariance, atol=1e-12)


def test_one_number_that_mixes_axes_is_matched_exactly() -> None:
    row = np.array([0.0, 1.0, 5.0])  # a visual shift: offset plus 5 m times heading
    measured = measured_directions(checked(information_along(row, 0.02)))

    assert measured.rank == 1
    assert measured.gain is not None
    innovation = np.array([0.3, 0.2, -0.1])
    assert row @ measured.gain @ innovation == pytest.approx(row @ innovation)
    assert row @ to_matrix(measured.covariance) @ row == pytest.approx(0.02**2)


def test_the_split_of_a_mixed_number_does_not_depend_on_units() -> None:
    row, scale = np.array([0.0, 1.0, 5.0]), np.array([1.0, 1000.0, 1.0])  # the second number in millimetres
    in_metres = measured_directions(checked(information_along(row, 0.02)))
    in_millimetres = measured_directions(checked(information_along(row / scale, 0.02)))

    assert in_metres.gain is not None
    np.testing.assert_allclose(in_millimetres.gain, scale[:, None] * in_metres.gain / scale, rtol=1e-9, atol=1e-9)


def test_very_unequal_sigmas_are_still_three_directions() -> None:
    assert measured_directions(checked(information_from_sigmas(1e-6, 10.0, 3.0))).rank == 3


def test_no_information_has_no_direction() -> None:
    assert measured_directions(checked(np.zeros((3, 3)))).rank == 0


def test_a_covariance_is_made_symmetric_to_rounding():
    covariance = np.diag([4.0, 1.0, 1e-6])
    covariance[0, 2] = 1e-12

    checked = checked_covariance(covariance)

    assert not isinstance(checked, str)
    np.testing.assert_array_equal(checked, checked.T)
    np.testing.assert_allclose(checked, covariance, atol=1e-12)


@pytest.mark.parametrize(
    ("covariance", "reason"),
    [
        (np.full((3, 3), np.inf), "not finite"),
        (np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), "not symmetric"),
        (np.diag([1.0, 1.0, 0.0]), "not positive definite"),
        (np.diag([1.0, -1.0, 1.0]), "not positive definite"),
    ],
)
def test_what_is_no_covariance_is_told(covariance, reason):
    assert reason in checked_covariance(covariance)


def test_a_covariance_of_another_shape_is_an_error():
    with pytest.raises(ShapeError, match=r"shape \(3, 3\), not \(2, 2\)"):
        checked_covariance(np.eye(2))
