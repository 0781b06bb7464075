"""Six floats against numpy's 3x3 matrices."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimation import symmetric as sym


def random_covariance(rng: np.random.Generator) -> tuple[sym.Sym3, np.ndarray]:
    root = rng.normal(size=(3, 3)) * [1.0, 0.3, 0.01]
    matrix = root.T @ root
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = matrix.tolist()
    return (xx, xy, xt, yy, yt, tt), matrix


def test_congruence_is_the_matrix_product() -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        packed, matrix = random_covariance(rng)
        angle, u, v = rng.normal(size=3)
        cos, sin = math.cos(angle), math.sin(angle)
        a = np.array([[cos, -sin, u], [sin, cos, v], [0.0, 0.0, 1.0]])

        actual = sym.to_matrix(sym.congruence(packed, cos, sin, u, v))

        np.testing.assert_allclose(actual, a @ matrix @ a.T, rtol=1e-12, atol=1e-14)


def test_sheared_adds_the_first_number_to_the_third() -> None:
    packed, matrix = random_covariance(np.random.default_rng(1))
    a = np.eye(3)
    a[2, 0] = 0.7

    np.testing.assert_allclose(sym.to_matrix(sym.sheared(packed, 0.7)), a @ matrix @ a.T, rtol=1e-12)


def test_inverse_is_numpys() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        packed, matrix = random_covariance(rng)
        inverse = sym.inverse(packed)

        assert inverse is not None
        np.testing.assert_allclose(sym.to_matrix(inverse), np.linalg.inv(matrix), rtol=1e-7)


@pytest.mark.parametrize(
    "singular",
    [
        sym.ZERO,
        (1.0, 1.0, 0.0, 1.0, 0.0, 1.0),  # x and y are one
        (1.0, 0.0, 0.0, 1.0, 0.0, 0.0),  # no theta
        (1.0, 0.0, 2.0, 1.0, 0.0, 1.0),  # indefinite
        (1e-320, 0.0, 0.0, 1.0, 0.0, 1.0),  # its inverse is no float
    ],
)
def test_what_has_no_inverse_gets_none(singular: sym.Sym3) -> None:
    assert sym.inverse(singular) is None
