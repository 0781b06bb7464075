"""The noise that is left: factors of what was stated, and directions that nobody measured."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark_calibration.solver import scale_covariances


def test_a_corridor_that_slants_to_the_robot_stays_where_it_is() -> None:
    """Factors that differ by axis would turn it, and deny what was never measured."""
    along = np.array([math.cos(0.6), math.sin(0.6), 0.0])
    across = np.array([-math.sin(0.6), math.cos(0.6), 0.0])
    corridor = 100.0**2 * np.outer(along, along) + 0.01**2 * np.outer(across, across) + np.diag([0.0, 0.0, 0.01**2])

    scaled = scale_covariances(corridor[np.newaxis], np.array([0.9, 0.2, 0.02]))[0]

    assert along @ np.linalg.inv(scaled) @ along < 1.0 / 50.0**2
    assert 0.002 < math.sqrt(across @ scaled @ across) < 0.01
    assert scaled[2, 2] == pytest.approx(0.0002**2)


def test_what_was_measured_is_scaled_by_axis() -> None:
    stated = np.array([[[4e-4, 1e-4, 0.0], [1e-4, 4e-4, 0.0], [0.0, 0.0, 1e-4]]])

    scaled = scale_covariances(stated, np.array([1.0, 2.0, 3.0]))[0]

    assert scaled == pytest.approx(np.array([[4e-4, 2e-4, 0.0], [2e-4, 16e-4, 0.0], [0.0, 0.0, 9e-4]]))
