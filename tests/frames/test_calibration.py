"""Calibrations refuse what cannot be."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from trailmark.errors import ShapeError
from trailmark.frames import Arrays, DepthCamera, GroundPlane, Omni, Pinhole


def test_the_camera_matrix_takes_a_ray_to_its_pixel() -> None:
    camera = Pinhole(fx=500.0, fy=400.0, cx=320.0, cy=240.0)

    u, v, w = camera.matrix() @ [0.1, -0.2, 2.0]

    assert (u / w, v / w) == (pytest.approx(345.0), pytest.approx(200.0))


@pytest.mark.parametrize(("fx", "fy"), [(0.0, 1.0), (1.0, -1.0), (math.nan, 1.0)])
def test_focal_lengths_are_positive(fx: float, fy: float) -> None:
    with pytest.raises(ShapeError, match="focal lengths must be positive"):
        Pinhole(fx, fy, 0.0, 0.0)


@pytest.mark.parametrize("count", [1, 2, 3, 6, 7, 9])
def test_distortion_has_the_lengths_of_opencv(count: int) -> None:
    with pytest.raises(ShapeError, match=f"distortion has 4, 5 or 8 numbers .* not {count}"):
        Pinhole(1.0, 1.0, 0.0, 0.0, (0.0,) * count)


@pytest.mark.parametrize("scales", [(1e-3,), (1e-3, 0.0), (-1e-3, 1e-3), (math.nan, 1e-3), (1.0, 1.0, 1.0)])
def test_scales_of_the_ground_are_two_positive_numbers(scales: Any) -> None:
    with pytest.raises(ShapeError, match="metres_per_pixel must be two positive numbers"):
        GroundPlane(scales)


@pytest.mark.parametrize("flat", [np.zeros((2, 2)), np.ones(3), np.array([[1.0, math.nan]])])
def test_a_flat_field_is_a_picture_of_positive_numbers(flat: Any) -> None:
    with pytest.raises(ShapeError, match="flat_field must be"):
        GroundPlane((1e-3, 1e-3), flat_field=flat)


def test_a_flat_field_is_kept_as_float32_and_cannot_be_written() -> None:
    ground = GroundPlane((1e-3, 1e-3), flat_field=np.ones((2, 3)))  # type: ignore[arg-type]

    assert ground.flat_field is not None
    assert ground.flat_field.dtype == np.float32
    assert not ground.flat_field.flags.writeable


def test_defaults_say_the_usual() -> None:
    assert Omni().turns == "counterclockwise"
    assert DepthCamera(Pinhole(1.0, 1.0, 0.0, 0.0)).depth_kind == "z"
    assert dict(Arrays().arrays) == {}
