from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from trailmark_divs.paper_shift import PaperShift, hill_climb, winc

VECTOR = arrays(np.float64, 50, elements=st.floats(0, 2880).map(lambda value: round(value, 3)))


def star(replay, piece):
    """The reference's correlation operator: both centred, divided by the largest magnitude, circular, by FFT."""
    operands = []
    for values in (replay, piece):
        centred = values - values.mean()
        largest = np.abs(centred).max()
        operands.append(centred / largest if largest > 0 else np.zeros_like(centred))
    padded = np.zeros(len(replay))
    padded[: len(piece)] = operands[1]
    return np.fft.ifft(np.fft.fft(operands[0]) * np.conj(np.fft.fft(padded))).real


def plain_winc(taught, seen, e):
    """Eq. (8) in the reference's words."""
    d = len(taught)
    response = np.zeros(2 * d)
    for i in range(d - e + 1):
        response[d - i : 2 * d - i] += star(seen, taught[i : i + e])
    return response


def plain_climb(response, last):
    """Hill climbing in the reference's words."""
    height = response - response.min()
    candidates = []
    for step in (1, -1):
        best, where, i = height[last], last, last + step
        while 0 <= i < len(height) and height[i] >= best:
            best, where, i = height[i], i, i + step
        distance = abs(where - last)
        candidates.append((best if distance == 0 else best / distance, where))
    (right, right_index), (left, left_index) = candidates
    return right_index if right >= left else left_index


@given(VECTOR, VECTOR)
def test_winc_agrees_with_a_plain_fft_transcription(taught, seen):
    np.testing.assert_allclose(winc(taught, seen, 5), plain_winc(taught, seen, 5), atol=1e-8)


@pytest.mark.parametrize(("d", "e"), [(50, 5), (50, 10), (40, 5), (100, 20), (12, 12)])
def test_winc_agrees_with_the_transcription_for_any_size(d, e):
    rng = np.random.default_rng(7)
    taught, seen = rng.uniform(0, 500, (2, d))

    np.testing.assert_allclose(winc(taught, seen, e), plain_winc(taught, seen, e), atol=1e-8)


def test_constant_vectors_respond_nowhere():
    assert not winc(np.full(50, 7.0), np.full(50, 7.0), 5).any()


@given(arrays(np.float64, 30, elements=st.floats(-5, 5)), st.integers(0, 29))
def test_hill_climbing_agrees_with_a_plain_transcription(response, last):
    assert hill_climb(response, last) == plain_climb(response, last)


@pytest.mark.parametrize(
    ("response", "last", "expected"),
    [
        ([0, 1, 2, 3, 2, 1, 0], 3, 3),  # on the summit: stays
        ([0, 1, 2, 3, 2, 1, 0], 2, 3),  # one column uphill, nothing lost
        ([5, 2, 1, 2, 5, 0], 2, 4),  # equal hills: the right one
        ([6, 2, 1, 2, 5, 0], 2, 0),  # the higher of two at the same distance
        ([9, 5, 4, 0, 3.9, 0], 2, 0),  # 9 at 2 columns beats staying at 4
        ([0, 1, 1, 1, 4, 0], 1, 4),  # across a plateau
        ([0, 3, 3, 3, 4, 0], 1, 1),  # 4 at 3 columns is worth less than 3 here: very sticky
    ],
)
def test_hill_climbing_of_hills_worked_by_hand(response, last, expected):
    assert hill_climb(np.array(response, dtype=float), last) == expected


def test_the_first_shift_is_the_global_maximum_and_the_next_climb():
    rng = np.random.default_rng(3)
    taught, seen = rng.uniform(0, 500, (2, 50))
    shift = PaperShift(5)

    first = shift.update(taught, seen)
    assert first == np.argmax(plain_winc(taught, seen, 5)) - 50
    second = shift.update(taught, taught)
    assert second == plain_climb(plain_winc(taught, taught, 5), int(first) + 50) - 50
    shift.restart()
    assert shift.update(taught, taught) == 0.0


def test_content_further_right_than_taught_is_a_positive_shift():
    rng = np.random.default_rng(3)
    taught = rng.uniform(0, 500, 50)

    assert PaperShift(5).update(taught, np.roll(taught, 4)) == 4.0
    assert PaperShift(5).update(taught, np.roll(taught, -6)) == -6.0
