"""The image circle and the bearings about its centre."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import pytest

from trailmark.errors import ConfigError, ShapeError
from trailmark.frames import Omni
from trailmark.geometry import Pose2, wrap_angle
from trailmark_omni_surf.centre import CentreFinder
from trailmark_omni_surf.circle import BearingCamera, find_circle
from trailmark_omni_surf.circle_kernels import rim_coverages
from trailmark_omni_surf.config import OmniSurfConfig


def finder(calibration: Omni | None = None, **config: object) -> CentreFinder:
    return CentreFinder.of(calibration or Omni(), OmniSurfConfig.model_validate(config))


@pytest.mark.parametrize("centre", [(161.3, 118.6), (150.0, 121.0), (172.4, 115.2)])
def test_the_centre_is_found_within_a_pixel(omni: Any, centre: tuple[float, float]) -> None:
    circle = find_circle(omni.room(centre=centre).render(Pose2(0.6, -0.4, 1.0)))

    assert circle is not None
    assert math.hypot(circle.centre_u - centre[0], circle.centre_v - centre[1]) < 1.0
    assert circle.radius_px == pytest.approx(115.0, abs=1.0)
    assert circle.coverage > 0.9


def test_a_rim_cut_off_by_the_picture_is_found(omni: Any) -> None:
    image = omni.room().render(Pose2())[25:]

    circle = find_circle(image)

    assert circle is not None
    assert math.hypot(circle.centre_u - 161.3, circle.centre_v - 93.6) < 1.0


def test_a_stretched_picture_is_refused_with_the_reason(omni: Any) -> None:
    image = cv2.resize(omni.room().render(Pose2()), None, fx=1.3, fy=1.0)

    assert "no image circle" in finder().look(np.asarray(image, np.uint8))


def test_an_empty_picture_has_no_circle() -> None:
    assert find_circle(np.full((240, 320), 80, np.uint8)) is None
    assert "no image circle: 0%" in finder().look(np.full((240, 320), 80, np.uint8))


def test_a_centre_that_is_20_px_off_is_contradicted_by_the_picture(omni: Any) -> None:
    image = omni.room().render(Pose2())

    assert finder(Omni(centre_u=161.0, centre_v=119.0)).look(image) == ""
    assert "the calibration puts the image centre at (181.0, 119.0)" in finder(
        Omni(centre_u=181.0, centre_v=119.0)
    ).look(image)


def test_without_the_check_the_calibration_is_believed(omni: Any) -> None:
    calibration = Omni(centre_u=181.0, centre_v=119.0, radius_outer_px=100.0)
    centre = finder(calibration, check_centre=False)

    assert centre.look(omni.room().render(Pose2())) == ""
    assert centre.camera.centre_u == 181.0


def test_half_a_calibration_is_refused() -> None:
    with pytest.raises(ConfigError, match="both centre_u and centre_v"):
        finder(Omni(centre_u=160.0))
    with pytest.raises(ConfigError, match="needs radius_outer_px"):
        finder(Omni(centre_u=160.0, centre_v=120.0), check_centre=False)
    with pytest.raises(ShapeError, match="neither in the calibration nor found"):
        BearingCamera.of(Omni(), None)


@pytest.mark.parametrize("turns", ["clockwise", "counterclockwise"])
@pytest.mark.parametrize("forward_deg", [0.0, 90.0, -135.0])
def test_bearings_follow_direction_sense_and_forward(turns: Any, forward_deg: float) -> None:
    calibration = Omni(100.0, 100.0, 10.0, 90.0, turns, forward_deg)
    camera = BearingCamera.of(calibration, None)
    forward = math.radians(forward_deg)
    left = forward + (-math.pi / 2 if turns == "counterclockwise" else math.pi / 2)  # v points down
    uv = np.array([[100 + 50 * math.cos(a), 100 + 50 * math.sin(a)] for a in (forward, left)])

    bearings = camera.bearings(uv)

    assert wrap_angle(bearings[0]) == pytest.approx(0.0, abs=1e-9)
    assert bearings[1] == pytest.approx(math.pi / 2)
    np.testing.assert_allclose(camera.distances(uv), 50.0)


def test_the_ring_leaves_out_hub_and_rim() -> None:
    camera = BearingCamera.of(Omni(100.0, 100.0, 20.0, 90.0), None)

    inside = camera.is_inside(np.array([[100.0, 100.0], [150.0, 100.0], [189.0, 100.0], [122.0, 100.0]]))

    assert inside.tolist() == [False, True, False, False]


def test_coverage_counts_the_sectors_that_show_an_edge_across_the_radius() -> None:
    angles = np.radians(np.arange(0.5, 180.5))  # half a circle, and the same turned by 90 degrees: along the rim
    rim = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points, tangents = (160.0, 120.0) + 100.0 * rim, rim[:, ::-1] * (-1.0, 1.0)
    circles = np.array([[160.0, 120.0, 100.0], [160.0, 120.0, 90.0], [0.0, 120.0, 100.0], [160.0, 112.0, 100.0]])

    across = rim_coverages(circles, points, rim, 320, 240, 3.0, 0.94, 180)
    along = rim_coverages(circles, points, tangents, 320, 240, 3.0, 0.94, 180)

    assert across[0] == pytest.approx(0.5, abs=0.02)
    assert across[1] == 0.0  # another radius
    assert across[2] == 0.0  # less than half of it is in the picture
    assert 0.05 < across[3] < 0.2  # 8 px off: near the ends of the half circle alone
    assert not along.any()
