from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.report.numbers import length_unit, percent_text, significant


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (12.345, "12.3"),
        (0.012345, "0.0123"),
        (1234.6, "1235"),
        (99.96, "100"),
        (9.996, "10.0"),
        (-0.5, "-0.500"),
        (3.2e-7, "3.2e-07"),
        (math.inf, "inf"),
        (math.nan, "\u2013"),
        (None, "\u2013"),
    ],
)
def test_numbers_have_three_digits(value: float | None, text: str) -> None:
    assert significant(value) == text


@given(st.floats(1e-3, 1e6))
def test_what_is_shown_is_the_number_within_half_a_percent(value: float) -> None:
    assert float(significant(value)) == pytest.approx(value, rel=0.005)


@pytest.mark.parametrize(
    ("fraction", "text"),
    [(1.0, "100.0"), (0.99996, ">99.9"), (0.5, "50.0"), (1e-5, "<0.1"), (0.0, "0.0"), (None, "\u2013")],
)
def test_a_share_is_whole_only_when_it_is(fraction: float | None, text: str) -> None:
    assert percent_text(fraction) == text


def test_short_lengths_are_shown_in_millimetres() -> None:
    assert length_unit([0.02, 0.05, None, 3.0]) == ("mm", 1000.0)
    assert length_unit([0.2, 0.5]) == ("m", 1.0)
    assert length_unit([None]) == ("m", 1.0)
    assert length_unit([7.5e-05, 2.0, 5.0]) == ("mm", 1000.0)
    assert length_unit([9e-04, 2.0, 5.0]) == ("m", 1.0)
    assert length_unit([7.5e-05, 2.0, 1234.5]) == ("m", 1.0)
    assert length_unit([1e-16, 2.0, 5.0]) == ("m", 1.0)
