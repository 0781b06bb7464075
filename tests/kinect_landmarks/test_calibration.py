"""Which depth pixel belongs to which colour pixel."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trailmark.errors import ConfigError
from trailmark.frames import DepthCamera, Pinhole
from trailmark.geometry import Pose3
from trailmark_kinect_landmarks.calibration import Crop, depth_pixels, ratios, register_depth

COLOUR, DEPTH = Pinhole(525.0, 525.0, 319.5, 239.5), Pinhole(585.0, 585.0, 319.5, 239.5)


def test_the_ratios_are_sizes_of_depth_by_cropped_colour() -> None:
    crop = Crop(left=30, right=34, top=24, bottom=24)

    assert crop.size((640, 480)) == (576, 432)
    assert ratios((640, 480), (576, 432)) == pytest.approx((640 / 576, 480 / 432))


def test_the_corners_of_the_crop_are_the_corners_of_the_depth_picture() -> None:
    crop = Crop(left=30, right=34, top=24, bottom=24)

    pixels, exists = depth_pixels(np.array([[30.0, 24.0], [605.0, 455.0]]), crop, (640, 480), (640, 480))

    assert pixels.tolist() == [[0, 0], [639, 479]]
    assert exists.all()


def test_a_rectangle_at_the_borders_gives_the_crop() -> None:
    assert Crop.from_rectangles((30.0, 605.0, 24.0, 455.0), (640, 480)) == Crop(30, 34, 24, 24)


def test_colour_outside_of_the_crop_has_no_depth() -> None:
    pixels, exists = depth_pixels(
        np.array([[5.0, 100.0], [300.0, 470.0]]), Crop(30, 34, 24, 24), (640, 480), (320, 240)
    )

    assert not exists.any()
    assert (pixels >= 0).all()
    assert (pixels <= [319, 239]).all()


@given(st.floats(-0.5, 639.49), st.floats(-0.5, 479.49), st.integers(0, 200), st.integers(0, 200))
@settings(max_examples=60, deadline=None)
def test_every_depth_pixel_that_is_said_to_exist_exists(u: float, v: float, left: int, top: int) -> None:
    pixels, exists = depth_pixels(np.array([[u, v]]), Crop(left=left, top=top), (640, 480), (512, 424))

    assert pixels.dtype.kind == "i"
    assert (pixels[0] >= 0).all()
    assert (pixels[0] <= [511, 423]).all()
    assert exists[0] == (u - left + 0.5 >= 0 and v - top + 0.5 >= 0)


def test_a_crop_of_everything_is_refused() -> None:
    with pytest.raises(ConfigError, match="does not fit into a colour picture of 640 x 480 px"):
        Crop(left=400, right=300).size((640, 480))


def test_registered_depth_is_left_alone() -> None:
    depth_m = np.full((4, 4), 2.0, np.float32)

    assert register_depth(depth_m, DepthCamera(COLOUR), (4, 4)) is depth_m


def test_a_wall_seen_through_another_lens_stays_a_wall_without_holes() -> None:
    wide = DepthCamera(Pinhole(585.0, 585.0, 319.5, 239.5), Pinhole(400.0, 400.0, 319.5, 239.5))

    registered = register_depth(np.full((480, 640), 2.0, np.float32), wide, (640, 480))

    np.testing.assert_array_equal(registered, np.float32(2.0))


def test_a_point_lands_where_both_cameras_see_it() -> None:
    # The depth camera stands 25 mm right of the colour camera and looks the same way.
    camera = DepthCamera(COLOUR, DEPTH, Pose3(0.0, -0.025, 0.0))
    point = np.array([0.3, -0.2, 2.0])  # right, down, ahead of the depth camera
    u, v = (round(585.0 * value / 2.0 + centre) for value, centre in zip(point, (319.5, 239.5)))
    depth_m = np.full((480, 640), np.nan, np.float32)
    depth_m[v, u] = 2.0

    rows, columns = np.nonzero(np.isfinite(register_depth(depth_m, camera, (640, 480))))

    assert columns.mean() == pytest.approx(525.0 * 0.325 / 2.0 + 319.5, abs=1.0)
    assert rows.mean() == pytest.approx(525.0 * -0.2 / 2.0 + 239.5, abs=1.0)


def test_the_nearer_of_two_surfaces_is_seen() -> None:
    depth_m = np.full((480, 640), 3.0, np.float32)
    depth_m[:, 300:340] = 1.0
    camera = DepthCamera(COLOUR, DEPTH, Pose3(0.0, -0.05, 0.0))

    registered = register_depth(depth_m, camera, (640, 480))

    assert registered[240, round(525.0 * (0.05 / 1.0) + 319.5)] == 1.0


def test_a_range_stays_a_range() -> None:
    camera = DepthCamera(COLOUR, COLOUR, depth_kind="range")
    depth_m = np.full((480, 640), 2.0, np.float32)

    np.testing.assert_allclose(register_depth(depth_m, camera, (640, 480))[1:-1, 1:-1], 2.0, rtol=1e-6)
