from __future__ import annotations

import numpy as np
import pytest

from trailmark.errors import DataError, ShapeError
from trailmark.estimates import information_along, information_from_sigmas
from trailmark.evaluation import chi2_quantile, consistency_of, nees
from trailmark.evaluation.consistency import information_rank

SIGMAS = np.array([0.1, 0.2, 0.01])


def _errors(n: int, scale: float = 1.0) -> np.ndarray:
    return np.random.default_rng(7).normal(size=(n, 3)) * SIGMAS * scale


def _information(n: int) -> np.ndarray:
    return np.tile(information_from_sigmas(*SIGMAS), (n, 1, 1))


def test_quantiles_are_those_of_the_tables() -> None:
    np.testing.assert_allclose(chi2_quantile(0.95, [1.0, 3.0, 10.0]), [3.841, 7.815, 18.307], atol=1e-3)


def test_nees_by_hand() -> None:
    squares, dof = nees(np.array([[0.1, 0.4, 0.03]]), _information(1))

    assert squares[0] == pytest.approx(1.0 + 4.0 + 9.0)
    assert dof[0] == 3


def test_a_whole_turn_is_no_heading_error() -> None:
    squares, _ = nees(np.array([[0.0, 0.0, 2.0 * np.pi]]), _information(1))

    assert squares[0] == pytest.approx(0.0, abs=1e-12)


def test_right_covariances_are_consistent() -> None:
    found = consistency_of(*nees(_errors(2000), _information(2000)))

    assert found.verdict == "consistent"
    assert found.per_dof == pytest.approx(1.0, abs=0.05)
    assert found.inside == pytest.approx(0.95, abs=0.02)
    assert (found.n, found.dof) == (2000, 6000)


@pytest.mark.parametrize(
    ("scale", "verdict"), [(3.0, "overconfident"), (2.0, "consistent"), (0.5, "consistent"), (0.3, "underconfident")]
)
def test_errors_of_another_size_than_stated_are_told(scale: float, verdict: str) -> None:
    found = consistency_of(*nees(_errors(500, scale), _information(500)))

    assert found.verdict == verdict
    assert found.per_dof == pytest.approx(scale**2, rel=0.1)


def test_a_direction_that_was_not_measured_is_no_degree_of_freedom() -> None:
    one = information_along([0.3, 0.0, 2.0], 0.05)
    two = information_from_sigmas(0.1, np.inf, 1e-4)
    none = np.zeros((3, 3))

    np.testing.assert_array_equal(information_rank(np.array([one, two, none])), [1, 2, 0])


def test_the_interval_narrows_with_the_number_of_estimates() -> None:
    few, many = (consistency_of(np.full(n, 3.0), np.full(n, 3.0)) for n in (10, 1000))

    assert few.lower < many.lower < 1.0 < many.upper < few.upper
    assert few.lower == pytest.approx(16.791 / 30, abs=1e-3)  # chi-square of 30, 2.5 %


def test_estimates_without_a_number_are_left_out() -> None:
    found = consistency_of(np.array([1.0, np.nan, 2.0]), np.array([1.0, 1.0, 0.0]))

    assert (found.n, found.dof, found.per_dof) == (1, 1, 1.0)


def test_names_carry_the_counts() -> None:
    names = set(consistency_of(np.ones(4), np.full(4, 2.0)).metrics("nis"))

    assert names == {"nis_per_dof[n=4,dof=8]", "nis_inside_fraction[p=0.95,n=4]"}


def test_no_estimate_has_no_consistency() -> None:
    with pytest.raises(DataError, match="at least one estimate"):
        consistency_of(np.array([]), np.array([]))


def test_shapes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ShapeError, match=r"\(2, 3\) and information \(1, 3, 3\)"):
        nees(np.zeros((2, 3)), _information(1))
