"""Pixels that stand for regions."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark_kinect_landmarks.finders import Regions
from trailmark_kinect_landmarks.landmarks import anchors


@pytest.fixture
def grey() -> np.ndarray:
    picture = np.full((60, 80), 100, np.uint8)
    picture[20:40, 30:50] = 200
    return picture


def test_a_region_is_anchored_at_its_best_corner(grey: np.ndarray) -> None:
    uv, strength = anchors(grey, Regions(["rectangle"], np.array([[26.0, 16.0, 14.0, 14.0]])), "corner")

    np.testing.assert_allclose(uv, [[29.5, 19.5]], atol=1.0)
    assert strength[0] > 0.0


@pytest.mark.parametrize("at", ["corner", "centre"])
@pytest.mark.parametrize("corner", [(-40.0, 10.0), (90.0, 10.0), (10.0, -40.0), (10.0, 80.0)])
def test_a_region_beyond_the_border_is_no_error(grey: np.ndarray, corner: tuple[float, float], at: str) -> None:
    boxes = np.array([[*corner, 10.0, 10.0], [30.0, 20.0, 9.0, 9.0]])

    uv, strength = anchors(grey, Regions(["ellipse", "blob"], boxes), at)

    assert np.isfinite(uv).all()
    assert strength.shape == (2,)
    if at == "corner":
        assert (uv[0] >= 0.0).all()
        assert (uv[0] <= (79.0, 59.0)).all()
        assert strength[0] == 0.0
