"""What a motion has beside the noise of pixels: none of it at rest, honest for a metre, not for its pieces alone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.systematic import CameraErrors, motion_systematic

PIXEL_M = 4e-4
CAMERA = CameraErrors(width_px=400, metres_per_pixel=(PIXEL_M, PIXEL_M), tilt_rad=2e-4, unevenness=0.1)
STIFF, EVEN = replace(CAMERA, tilt_rad=0.0), replace(CAMERA, unevenness=0.0)


def test_a_robot_at_rest_has_no_other_errors_than_noise():
    assert not motion_systematic(ImageMotion(0.0, 0.0, 0.0), 0.1, CAMERA).any()


def test_a_stiff_camera_in_even_light_has_none_either():
    assert not motion_systematic(ImageMotion(20.0, 5.0, 0.02), 0.1, replace(STIFF, unevenness=0.0)).any()


@pytest.mark.parametrize("n", [20, 100])
def test_what_light_does_in_a_metre_is_the_same_however_many_motions_it_takes(n):
    step = ImageMotion(1.0 / n / PIXEL_M, 0.0, 0.0)

    one = motion_systematic(step, 1.0, STIFF)

    sigma_px, turn_sigma = math.sqrt(n * one[0, 0]), math.sqrt(n * one[2, 2])  # of n that are taken for independent
    assert sigma_px * PIXEL_M == pytest.approx(0.007 * 0.1 * 1.0)
    assert turn_sigma == pytest.approx(0.007 * 0.1 * (1.0 / PIXEL_M / 400))


def test_a_camera_that_nods_shifts_and_turns_two_pictures():
    far = motion_systematic(ImageMotion(100.0, 0.0, 0.0), 0.1, EVEN)

    assert math.sqrt(far[0, 0]) == pytest.approx(math.sqrt(2.0) * 2e-4 * 400)
    assert math.sqrt(far[2, 2]) == pytest.approx(math.sqrt(2.0) * 0.2 * 2e-4)


def test_near_pictures_nod_alike():
    near, far = (motion_systematic(ImageMotion(u, 0.0, 0.0), 0.1, EVEN) for u in (2.5, 25.0))

    np.testing.assert_allclose(near, far / 10)


def test_pixels_that_are_not_square_are_told_apart():
    oblong = motion_systematic(
        ImageMotion(30.0, 0.0, 0.0), 0.1, replace(CAMERA, metres_per_pixel=(PIXEL_M, 2 * PIXEL_M))
    )

    np.testing.assert_allclose(oblong[1, 1], oblong[0, 0] / 4)
