"""Correction of depth, and the depth of a landmark."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.frames import Scan
from trailmark_kinect_landmarks.depth import DepthLimits, correct_depth, depth_at, scan_depth

LIMITS = DepthLimits()


def _wall(depth_m: float = 2.0) -> np.ndarray:
    return np.full((40, 60), depth_m, np.float32)


def test_a_small_hole_is_filled_and_a_large_one_stays() -> None:
    wall = _wall()
    wall[10, 10] = np.nan
    wall[20:35, 20:35] = np.nan

    corrected = correct_depth(wall, None, LIMITS)

    assert corrected[10, 10] == 2.0
    assert np.isnan(corrected[27, 27])


def test_a_pixel_between_two_surfaces_is_not_believed() -> None:
    wall = _wall()
    wall[:, 30:] = 3.0
    wall[5:35:6, 30] = 2.5  # hangs in the air

    corrected = correct_depth(wall, None, LIMITS)

    assert not np.isin(2.5, corrected)


def test_a_highlight_with_holes_around_it_is_not_believed() -> None:
    wall, grey = _wall(), np.full((40, 60), 100, np.uint8)
    wall[10:30, 20:40] = np.nan
    wall[20, 30] = 1.2  # what a mirror shows
    grey[15:25, 25:35] = 255

    assert np.isnan(correct_depth(wall, grey, LIMITS)[15:25, 25:35]).all()


@pytest.mark.parametrize("depth_m", [0.2, 9.0, np.nan, 0.0, -1.0])
def test_depth_out_of_the_sensor_s_reach_is_unknown(depth_m: float) -> None:
    assert np.isnan(correct_depth(_wall(depth_m), None, LIMITS)).all()


def test_a_landmark_s_depth_is_the_median_of_its_window() -> None:
    wall = _wall()
    wall[10, 10], wall[11, 10] = 2.03, 1.97

    assert depth_at(wall, np.array([[10.4, 10.2]]))[0] == 2.0


def test_a_landmark_without_depth_has_none() -> None:
    wall = _wall()
    wall[8:13, 8:13] = np.nan
    wall[10, 10] = 2.0

    assert np.isnan(depth_at(wall, np.array([[10.0, 10.0]]))[0])


def test_a_landmark_on_the_edge_of_two_surfaces_has_no_depth() -> None:
    wall = _wall()
    wall[:, 30:] = 3.0

    found = depth_at(wall, np.array([[30.0, 20.0], [40.0, 20.0]]))

    assert np.isnan(found[0])
    assert found[1] == 3.0


def test_no_landmarks_have_no_depths_and_corners_are_inside() -> None:
    assert depth_at(_wall(), np.empty((0, 2))).shape == (0,)
    assert depth_at(_wall(), np.array([[0.0, 0.0], [59.0, 39.0]])).tolist() == [2.0, 2.0]


def test_a_laser_fills_in_where_it_looks() -> None:
    scan = Scan(np.array([1.0, np.nan, 3.0]), angle_min_rad=-0.1, angle_step_rad=0.1, range_max_m=5.0)

    found = scan_depth(scan, np.array([-0.09, 0.0, 0.1, 0.14, 0.5]), max_gap_rad=0.02)

    np.testing.assert_array_equal(found, [1.0, np.nan, 3.0, np.nan, np.nan])
