"""Equations (3) and (4): from shifts in the picture to motion on the ground."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.geometry import Pose2
from trailmark_ground_vo.motion import ImageMotion, combine, ground_information, pose_prev_now

SCALE = (3.906e-4, 3.917e-4)
ASPECT = SCALE[1] / SCALE[0]

motions = st.builds(ImageMotion, st.floats(-40, 40), st.floats(-40, 40), st.floats(-0.1, 0.1))


@given(motions)
def test_two_viewpoints_of_a_rigid_motion_combine_to_it(motion):
    lower, upper = (motion.about(0.0, offset, ASPECT) for offset in (96.0, -96.0))

    combined = combine((lower.u, lower.v), (upper.u, upper.v), 192.0, ASPECT)

    assert combined.turn_rad == pytest.approx(motion.turn_rad, abs=1e-12)
    assert (combined.u, combined.v) == pytest.approx((motion.u, motion.v), abs=1e-9)


def test_one_pixel_between_viewpoints_128_px_apart_is_one_step_of_the_search():
    motion = combine((5.0, 2.0), (4.0, 2.0), 128.0)

    assert motion.turn_rad == pytest.approx(math.atan(1 / 128))
    assert (motion.u, motion.v) == (4.5, 2.0)


def test_the_content_moves_against_the_camera():
    pose = pose_prev_now(ImageMotion(10.0, -5.0, 0.0), (1e-3, 2e-3))

    assert (pose.x, pose.y, pose.theta) == pytest.approx((-0.010, -0.010, 0.0))


@given(motions)
def test_a_point_of_the_ground_stays_where_it_is(motion):
    """A pixel and where it moves to, seen from before and after, are one point of the ground."""
    u, v = 30.0, -70.0  # from the middle
    cos, sin = math.cos(motion.turn_rad), math.sin(motion.turn_rad)
    moved = (cos * u + sin * ASPECT * v + motion.u, cos * v - sin / ASPECT * u + motion.v)

    seen_before = np.array([u * SCALE[0], -v * SCALE[1]])
    seen_after = np.array([moved[0] * SCALE[0], -moved[1] * SCALE[1]])

    np.testing.assert_allclose(pose_prev_now(motion, SCALE) @ seen_after, seen_before, atol=1e-12)


def test_integration_is_exact_on_a_circle():
    """As printed, Eq. (4) would end 0.5 % of the way beside it."""
    step = Pose2.exp(3.7e-3, 0.0, 3.7e-3 / 0.75)
    content = step.inverse()
    motion = ImageMotion(content.x / SCALE[0], -content.y / SCALE[1], content.theta)
    n_steps = 500

    pose = Pose2()
    for _ in range(n_steps):
        pose = pose @ pose_prev_now(motion, SCALE)

    expected = Pose2.exp(n_steps * 3.7e-3, 0.0, n_steps * 3.7e-3 / 0.75)
    np.testing.assert_allclose(pose.array(), expected.array(), atol=1e-9)


def test_information_goes_through_the_derivative_of_the_base_motion():
    mounting, motion = Pose2(0.05, -0.02, math.pi - 0.1), ImageMotion(9.5, -1.5, 0.02)

    def base(parameters):
        camera = pose_prev_now(ImageMotion(*parameters), SCALE)
        return (mounting @ camera @ mounting.inverse()).array()

    at = motion.array()
    steps = np.diag([1e-4, 1e-4, 1e-7])
    derivative = np.stack([(base(at + d) - base(at - d)) / (2 * d.sum()) for d in steps], axis=1)
    covariance = np.diag([0.01, 0.02, 1e-6]) + 1e-4 * np.array([[0, 1, 0.001], [1, 0, 0.002], [0.001, 0.002, 0]])

    information = ground_information(np.linalg.inv(covariance), pose_prev_now(motion, SCALE), SCALE, mounting)

    np.testing.assert_allclose(np.linalg.inv(information), derivative @ covariance @ derivative.T, rtol=1e-5)
