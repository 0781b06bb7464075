from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from trailmark_divs.robust_shift import best_over_shifts, local_windows, shift_scores, summit

ALL = np.ones(50, dtype=bool)
VECTOR = arrays(np.float64, 50, elements=st.integers(0, 2880).map(float))


def plain_scores(taught, seen, usable, e, max_shift):
    """Windowed Pearson correlation, written down."""
    n = len(taught) - e + 1
    scores = []
    for shift in range(-max_shift, max_shift + 1):
        pairs = [(i, i + shift) for i in range(n) if 0 <= i + shift < n]
        total = 0.0
        for i, j in pairs:
            a, b = taught[i : i + e], seen[j : j + e]
            if usable[i : i + e].all() and usable[j : j + e].all() and np.ptp(a) > 0 and np.ptp(b) > 0:
                total += np.corrcoef(a, b)[0, 1]
        scores.append(total / np.sqrt(len(pairs) * n))
    return np.array(scores)


def scores_of(taught, seen, usable=ALL, e=5, max_shift=20):
    return shift_scores(local_windows(taught, usable, e), local_windows(seen, usable, e), max_shift)


@settings(max_examples=20)
@given(VECTOR, VECTOR)
def test_scores_agree_with_plain_correlation(taught, seen):
    np.testing.assert_allclose(scores_of(taught, seen), plain_scores(taught, seen, ALL, 5, 20), atol=1e-9)


def test_windows_with_unusable_columns_do_not_count():
    rng = np.random.default_rng(7)
    taught, seen = rng.uniform(0, 900, (2, 50))
    usable = ALL.copy()
    usable[[0, 1, 30, 49]] = False

    expected = plain_scores(taught, seen, usable, 5, 20)
    np.testing.assert_allclose(scores_of(taught, seen, usable), expected, atol=1e-9)
    taught[30] = 1e6
    np.testing.assert_allclose(scores_of(taught, seen, usable), expected, atol=1e-9)


@given(VECTOR, VECTOR)
def test_swapping_teach_and_replay_reverses_the_scores(taught, seen):
    np.testing.assert_allclose(scores_of(taught, seen), scores_of(seen, taught)[::-1], atol=1e-12)


@given(VECTOR, VECTOR)
def test_scores_are_correlations(taught, seen):
    assert np.all(np.abs(scores_of(taught, seen)) <= 1.0 + 1e-12)


@given(VECTOR, VECTOR, st.floats(0.2, 5.0), st.floats(-100, 100))
def test_scale_and_offset_of_a_vector_change_nothing(taught, seen, scale, offset):
    np.testing.assert_allclose(scores_of(taught, seen), scores_of(taught, scale * seen + offset), atol=1e-6)


@pytest.mark.parametrize("shift", [-13, -1, 0, 4, 17])
def test_a_cut_out_of_a_longer_vector_is_found_at_its_place(shift):
    scene = np.random.default_rng(7).uniform(0, 900, 90)
    taught, seen = scene[20:70], scene[20 - shift : 70 - shift]

    scores = scores_of(taught, seen)

    assert int(np.argmax(scores)) - 20 == shift
    assert scores.max() == pytest.approx(np.sqrt((46 - abs(shift)) / 46))


def test_a_fraction_of_a_column_is_found():
    edge = np.linspace(0, 99, 4000)
    scene = np.convolve(np.random.default_rng(7).uniform(0, 900, 4000), np.hanning(240), "same")

    def vector(start):
        return np.interp(np.arange(50) + start, edge, scene)

    for shift in (-3.4, -0.3, 0.0, 0.25, 2.5):
        scores = scores_of(vector(20), vector(20 - shift))
        found = summit(scores, int(np.argmax(scores))) - 20
        assert found == pytest.approx(shift, abs=0.15)


def test_blank_vectors_score_zero():
    assert not scores_of(np.zeros(50), np.full(50, 3.0)).any()


def test_best_over_shifts_is_the_best_score_with_each_teach_vector():
    rng = np.random.default_rng(7)
    taught, seen = rng.uniform(0, 900, (6, 50)), rng.uniform(0, 900, 50)

    best = best_over_shifts(taught, ALL, local_windows(seen, ALL, 5), 8)

    np.testing.assert_allclose(best, [scores_of(vector, seen, max_shift=8).max() for vector in taught])


@pytest.mark.parametrize(
    ("scores", "index", "reach", "expected"),
    [
        ([0.0, 1.0, 0.0], 1, 0, 1.0),
        ([0.0, 1.0, 1.0, 0.0], 1, 0, 1.5),
        ([1.0, 0.5, 0.0], 0, 0, 0.0),  # at an end there is no parabola
        ([0.0, 0.0, 1.0, 0.9, 0.0], 1, 1, 2.4),
        ([0.0, 0.0, 0.0], 1, 0, 1.0),  # flat
    ],
)
def test_summit_of_peaks_worked_by_hand(scores, index, reach, expected):
    assert summit(np.array(scores), index, reach) == pytest.approx(expected, abs=0.06)
