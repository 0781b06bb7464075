"""Angles are counter-clockwise and live in [-pi, pi)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.geometry import wrap_angle, wrap_angles

angles = st.floats(-1e6, 1e6)


@pytest.mark.parametrize(
    ("angle_rad", "expected"),
    [
        (0.0, 0.0),
        (math.pi, -math.pi),
        (-math.pi, -math.pi),
        (1.5 * math.pi, -0.5 * math.pi),
        (-1.5 * math.pi, 0.5 * math.pi),
        (5 * math.pi, -math.pi),
    ],
)
def test_known_angles(angle_rad: float, expected: float) -> None:
    assert wrap_angle(angle_rad) == pytest.approx(expected, abs=1e-12)
    assert wrap_angles([angle_rad])[0] == pytest.approx(expected, abs=1e-12)


@given(angles)
def test_a_wrapped_angle_is_in_range_and_points_the_same_way(angle_rad: float) -> None:
    wrapped = wrap_angle(angle_rad)

    assert -math.pi <= wrapped < math.pi
    assert math.sin(wrapped) == pytest.approx(math.sin(angle_rad), abs=1e-9)
    assert math.cos(wrapped) == pytest.approx(math.cos(angle_rad), abs=1e-9)


@given(st.floats(-math.pi, math.pi, exclude_max=True))
def test_an_angle_in_range_is_not_touched(angle_rad: float) -> None:
    assert wrap_angle(angle_rad) == angle_rad


@pytest.mark.parametrize("angle_rad", [math.nextafter(-math.pi, -4.0), math.nextafter(math.pi, 0.0), -1e-300, 1e15])
def test_rounding_never_leaves_the_range(angle_rad: float) -> None:
    assert -math.pi <= wrap_angle(angle_rad) < math.pi
    assert -math.pi <= wrap_angles([angle_rad])[0] < math.pi


@given(st.lists(angles, min_size=1, max_size=20))
def test_arrays_are_wrapped_as_their_elements(angles_rad: list[float]) -> None:
    wrapped = wrap_angles(angles_rad)

    assert np.all((wrapped >= -math.pi) & (wrapped < math.pi))
    turn = wrapped - [wrap_angle(angle) for angle in angles_rad]
    np.testing.assert_allclose(np.sin(turn), 0.0, atol=1e-9)


def test_the_shape_of_an_array_is_kept() -> None:
    assert wrap_angles(np.zeros((2, 3))).shape == (2, 3)
    assert wrap_angles([]).shape == (0,)
