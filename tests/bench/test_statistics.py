"""Statistics: against scipy, by hand, and with failures."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import wilcoxon

from trailmark_bench.statistics import compare_pairs, holm, mean_ranks, signed_rank_p, spreads


@pytest.mark.parametrize("n", [3, 5, 8, 20, 25])
def test_the_exact_p_is_scipys(n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(5):
        values = rng.normal(0.4, 1.0, n)

        assert signed_rank_p(values.tolist()) == pytest.approx(wilcoxon(values, method="exact").pvalue, abs=1e-12)


def test_the_approximate_p_is_scipys_with_ties_too() -> None:
    values = np.random.default_rng(1).integers(-4, 6, 80)
    values = values[values != 0]

    expected = wilcoxon(values, method="asymptotic", correction=True).pvalue
    assert signed_rank_p(values.tolist()) == pytest.approx(expected, rel=1e-9)


def test_ties_are_exact_by_counting_all_signs() -> None:
    values = [1.0, 1.0, -1.0, 2.0, 2.0]
    ranks = np.array([2.0, 2.0, 2.0, 4.5, 4.5])
    signs = np.array(np.meshgrid(*[[0, 1]] * 5)).reshape(5, -1).T
    sums = signs @ ranks
    observed = 13.0

    expected = min(1.0, 2 * min((sums >= observed).mean(), (sums <= observed).mean()))
    assert signed_rank_p(values) == pytest.approx(expected)


def test_no_difference_is_no_evidence() -> None:
    assert signed_rank_p([0.0, 0.0, 0.0]) is None
    assert signed_rank_p([1.0]) is None


def test_the_spread_of_finite_values_is_numpys() -> None:
    values = np.random.default_rng(3).lognormal(size=9)

    (spread,) = spreads([values.tolist()])

    np.testing.assert_allclose([spread.q1, spread.median, spread.q3], np.quantile(values, [0.25, 0.5, 0.75]))
    assert spread.low is not None
    assert spread.low <= spread.median <= spread.high


def test_the_interval_covers_the_true_median_as_often_as_it_says() -> None:
    samples = np.random.default_rng(4).exponential(size=(800, 15))

    found = spreads(samples.tolist())

    covered = np.mean([spread.low <= math.log(2) <= spread.high for spread in found])
    assert 0.90 <= covered <= 0.985  # a median takes few values: the interval errs to either side


def test_failures_decide_when_they_are_half() -> None:
    few, half, most = spreads([[1, 2, 3, 4, math.inf], [1, 2, math.inf, math.inf], [1, math.inf, math.inf]])

    assert few.median == 3
    assert few.high == math.inf
    assert half.median == math.inf
    assert most.median == math.inf
    assert most.q1 > 1


def test_one_value_has_no_interval() -> None:
    (spread,) = spreads([[2.0]])

    assert (spread.median, spread.q1, spread.low) == (2.0, 2.0, None)


def test_a_comparison_is_paired() -> None:
    baseline = [1.0, 10.0, 100.0, 1000.0, 10000.0]

    pair = compare_pairs([value * 0.9 for value in baseline], baseline)

    assert (pair.wins, pair.losses, pair.n) == (5, 0, 5)
    assert pair.ratio == pytest.approx(0.9)
    assert pair.p == pytest.approx(0.0625)


def test_a_failure_is_the_largest_difference_and_two_are_none() -> None:
    inf = math.inf

    worse = compare_pairs([1.0, inf, 1.0, inf], [2.0, 2.0, 2.0, inf])
    better = compare_pairs([1.0, 1.0], [inf, inf])

    assert (worse.wins, worse.losses) == (2, 1)
    assert worse.ratio is None
    assert better.difference == -inf
    assert better.wins == 2


def test_holm_by_hand() -> None:
    assert holm([0.01, None, 0.04, 0.03]) == pytest.approx([0.03, None, 0.06, 0.06])


def test_ranks_share_ties_and_failures_come_last() -> None:
    assert mean_ranks([[1.0, 2.0, 2.0, math.inf], [math.inf, 1.0, 5.0, math.inf]]) == [2.25, 1.75, 2.25, 3.75]


@given(st.lists(st.floats(-100, 100), min_size=2, max_size=12))
def test_p_does_not_depend_on_the_sign_or_the_order(values: list[float]) -> None:
    p = signed_rank_p(values)

    assert signed_rank_p([-value for value in values]) == p
    assert signed_rank_p(values[::-1]) == p
    assert p is None or 0.0 < p <= 1.0
