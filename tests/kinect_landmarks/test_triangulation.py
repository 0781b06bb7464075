"""Eqs. (7)-(16), worked by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.frames import Pinhole
from trailmark.geometry import Pose2
from trailmark_kinect_landmarks.triangulation import abscissa, epsilon, pixel_angles, planar_range, sights

LENS = Pinhole(500.0, 500.0, 320.0, 240.0)


def test_the_printed_equations_hold_for_a_range() -> None:
    seen = sights([math.atan2(3.0, 4.0)], [math.atan2(1.0, 2.0)], [5.0], "range")

    np.testing.assert_allclose([seen.dx[0], seen.dV[0], seen.dy[0]], [3.0, 4.0, 2.0], atol=1e-9)


def test_a_depth_from_the_camera_plane_is_already_perpendicular() -> None:
    seen = sights([math.atan2(3.0, 4.0)], [math.atan2(1.0, 2.0)], [4.0], "z")

    np.testing.assert_allclose([seen.dx[0], seen.dV[0], seen.dy[0]], [3.0, 4.0, 2.0], atol=1e-9)


def test_z_read_as_range_is_twelve_percent_wrong_at_the_image_edge() -> None:
    edge_rad = math.radians(28.5)

    assert sights(edge_rad, 0.0, 2.0, "z").dV[0] / sights(edge_rad, 0.0, 2.0, "range").dV[0] == pytest.approx(
        1.0 / math.cos(edge_rad)
    )


def test_a_distance_along_a_ray_in_space_is_brought_into_the_plane() -> None:
    point = np.array([3.0, 4.0, 12.0])  # right 3, ahead 4, up 12: the ray is 13 long, 5 of them in the plane
    alpha, beta = math.atan2(3.0, 4.0), math.atan2(12.0, 4.0)

    flat = planar_range(np.linalg.norm(point), alpha, beta)
    seen = sights(alpha, beta, flat, "range")

    np.testing.assert_allclose(flat, 5.0, atol=1e-9)
    np.testing.assert_allclose([seen.dx[0], seen.dV[0], seen.dy[0]], point, atol=1e-9)


def test_the_line_between_landmarks_left_and_right_of_the_axis() -> None:
    line = abscissa(dx_A=-1.0, dV_A=3.0, dx_B=2.0, dV_B=7.0)

    assert pytest.approx(5.0, abs=1e-9) == line.AB  # the sum of the outward distances is 3, the depths differ by 4
    assert line.omega == pytest.approx(math.atan(4.0 / 3.0), abs=1e-9)
    assert line.Dir == pytest.approx(-4.0, abs=1e-9)


def test_the_line_between_landmarks_on_one_side_of_the_axis() -> None:
    line = abscissa(dx_A=1.0, dV_A=7.0, dx_B=4.0, dV_B=3.0)

    assert pytest.approx(5.0, abs=1e-9) == line.AB  # as printed, Eq. (13) adds 1 and 4
    assert line.Dir == pytest.approx(4.0, abs=1e-9)


@pytest.mark.parametrize(("x_right", "side"), [(1.0, "right"), (-1.0, "left"), (0.0, "middle")])
def test_the_side_on_which_a_robot_stands_that_looks_at_the_middle(x_right: float, side: str) -> None:
    ahead = np.array([-x_right, 2.0]) / math.hypot(x_right, 2.0)
    right = np.array([ahead[1], -ahead[0]])
    A, B = np.array([-1.0, 2.0]) - (x_right, 0.0), np.array([1.0, 2.0]) - (x_right, 0.0)

    assert abscissa(float(A @ right), float(A @ ahead), float(B @ right), float(B @ ahead)).side == side


def test_the_way_from_the_start() -> None:
    assert epsilon(Pose2(0.3, -0.4, 1.0)) == pytest.approx(0.5, abs=1e-9)


def test_pinhole_angles_of_pixels_right_and_up_are_positive() -> None:
    alpha, beta = pixel_angles(np.array([[820.0, 240.0], [320.0, -260.0]]), LENS, (640, 480))

    np.testing.assert_allclose(alpha, [math.pi / 4, 0.0], atol=1e-9)
    np.testing.assert_allclose(beta, [0.0, math.pi / 4], atol=1e-9)


def test_linear_angles_agree_at_the_axis_and_the_edge_and_nowhere_between() -> None:
    kinect = Pinhole(320.0 / math.tan(math.radians(28.5)), 589.0, 320.0, 240.0)
    uv = np.array([[320.0, 240.0], [480.0, 240.0], [640.0, 240.0]])

    linear, pinhole = (pixel_angles(uv, kinect, (640, 480), model)[0] for model in ("linear", "pinhole"))

    np.testing.assert_allclose((linear - pinhole)[[0, 2]], 0.0, atol=1e-9)
    assert math.degrees(abs(linear[1] - pinhole[1])) == pytest.approx(0.94, abs=0.05)  # at 160 px of a 57 deg camera


def test_the_lens_distortion_is_taken_out() -> None:
    import cv2

    lens = Pinhole(517.3, 516.5, 318.6, 255.3, (0.2624, -0.9531, -0.0054, 0.0026, 1.1633))
    ray = np.array([[[0.3, -0.2, 1.0]]])
    uv = cv2.projectPoints(ray, np.zeros(3), np.zeros(3), lens.matrix(), np.array(lens.distortion))[0].reshape(1, 2)

    alpha, beta = pixel_angles(uv, lens, (640, 480))

    np.testing.assert_allclose(np.tan([alpha[0], beta[0]]), [0.3, 0.2], atol=1e-4)
