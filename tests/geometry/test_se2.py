"""Poses in the plane form a group, and twists move along arcs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from trailmark.errors import ShapeError
from trailmark.geometry import Pose2, Twist2, rotate_axes, wrap_angle

coordinates = st.floats(-100.0, 100.0)
poses = st.builds(Pose2, coordinates, coordinates, st.floats(-math.pi, math.pi, exclude_max=True))


def assert_close(left: Pose2, right: Pose2, atol: float = 1e-9) -> None:
    assert left.distance_to(right) <= atol
    assert abs(wrap_angle(left.theta - right.theta)) <= atol


def test_a_step_after_a_quarter_turn_goes_to_the_left() -> None:
    pose_map_next = Pose2(1.0, 2.0, math.pi / 2) @ Pose2(0.5, 0.0, 0.1)

    assert_close(pose_map_next, Pose2(1.0, 2.5, math.pi / 2 + 0.1))


def test_points_are_taken_from_the_right_frame_to_the_left_one() -> None:
    pose_map_base = Pose2(1.0, 2.0, math.pi / 2)

    np.testing.assert_allclose(pose_map_base @ np.array([1.0, 0.0]), [1.0, 3.0], atol=1e-12)
    np.testing.assert_allclose(pose_map_base @ np.array([[1.0, 0.0], [0.0, 1.0]]), [[1.0, 3.0], [0.0, 2.0]], atol=1e-12)


@given(poses, poses, poses)
def test_composition_is_associative(a: Pose2, b: Pose2, c: Pose2) -> None:
    assert_close((a @ b) @ c, a @ (b @ c))


@given(poses)
def test_a_pose_and_its_inverse_cancel(pose: Pose2) -> None:
    assert_close(pose @ pose.inverse(), Pose2())
    assert_close(pose.inverse() @ pose, Pose2())


@given(poses, poses)
def test_between_is_the_inverse_times_the_other(a: Pose2, b: Pose2) -> None:
    assert_close(a.between(b), a.inverse() @ b)
    assert_close(a @ a.between(b), b)


@given(poses, poses, poses)
def test_a_pose_moves_as_another_to_the_last_bit(a: Pose2, b: Pose2, c: Pose2) -> None:
    assert a.moved_as(b, c) == a @ b.between(c)


@given(poses, poses)
def test_composition_is_the_product_of_matrices(a: Pose2, b: Pose2) -> None:
    np.testing.assert_allclose((a @ b).matrix(), a.matrix() @ b.matrix(), atol=1e-9)


@given(poses, coordinates, coordinates)
def test_points_and_poses_move_alike(pose: Pose2, x: float, y: float) -> None:
    moved = pose @ Pose2(x, y, 0.0)

    np.testing.assert_allclose(pose @ np.array([x, y]), [moved.x, moved.y], atol=1e-9)


@given(st.floats(-10, 10), st.floats(-10, 10), st.floats(-3.1, 3.1))
def test_log_undoes_exp(forward_m: float, left_m: float, turn_rad: float) -> None:
    np.testing.assert_allclose(
        Pose2.exp(forward_m, left_m, turn_rad).log(), (forward_m, left_m, turn_rad), rtol=1e-6, atol=1e-7
    )


def test_exp_drives_a_quarter_circle() -> None:
    assert_close(Pose2.exp(math.pi / 2, 0.0, math.pi / 2), Pose2(1.0, 1.0, math.pi / 2))


def test_exp_of_half_the_twist_twice_is_exp_of_the_twist() -> None:
    half = Pose2.exp(0.4, -0.1, 0.3)

    assert_close(half @ half, Pose2.exp(0.8, -0.2, 0.6))


@pytest.mark.parametrize("turn_rad", [0.0, 1e-12, 1e-9, 9.9e-7, 1.01e-6, 1e-5])
def test_small_turns_lose_no_digits(turn_rad: float) -> None:
    pose = Pose2.exp(2.0, 1.0, turn_rad)

    # the series to second order is exact for turns this small
    assert pose.x == pytest.approx(2.0 - turn_rad / 2.0 - turn_rad**2 / 3.0, abs=8e-16)
    assert pose.y == pytest.approx(1.0 + turn_rad - turn_rad**2 / 6.0, abs=8e-16)
    np.testing.assert_allclose(pose.log(), (2.0, 1.0, turn_rad), rtol=0, atol=1e-9)


@given(poses, st.floats(-2, 2), st.floats(-2, 2), st.floats(-1, 1))
def test_the_adjoint_moves_a_twist_to_the_other_frame(
    pose: Pose2, forward_m: float, left_m: float, turn: float
) -> None:
    twist_a = pose.adjoint() @ np.array([forward_m, left_m, turn])

    left, right = Pose2.exp(*map(float, twist_a)) @ pose, pose @ Pose2.exp(forward_m, left_m, turn)
    assert_close(left, right, atol=1e-7)


@given(poses, poses)
def test_interpolation_begins_here_and_ends_there(a: Pose2, b: Pose2) -> None:
    assert_close(a.interpolate(b, 0.0), a)
    assert_close(a.interpolate(b, 1.0), b)


def test_interpolation_takes_the_shorter_turn() -> None:
    middle = Pose2(0.0, 0.0, 3.0).interpolate(Pose2(2.0, 0.0, -3.0), 0.5)

    assert_close(middle, Pose2(1.0, 0.0, math.pi))


@given(poses)
def test_arrays_hold_a_pose_bit_for_bit(pose: Pose2) -> None:
    assert Pose2.from_array(pose.array()) == pose


@given(st.floats(-1e4, 1e4))
def test_the_heading_is_wrapped(theta: float) -> None:
    assert Pose2(0.0, 0.0, theta).theta == wrap_angle(theta)


@pytest.mark.parametrize("values", [(math.nan, 0, 0), (0, math.inf, 0), (0, 0, math.nan)])
def test_a_pose_that_is_not_finite_is_refused(values: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="pose is not finite"):
        Pose2(*values)


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(ShapeError, match="three numbers"):
        Pose2.from_array([1.0, 2.0])
    with pytest.raises(ShapeError, match=r"shape \(2,\) or \(N, 2\)"):
        Pose2() @ np.zeros(3)


def test_a_pose_cannot_be_changed() -> None:
    with pytest.raises(AttributeError):
        Pose2().x = 1.0  # type: ignore[misc]


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-1, 1), st.floats(0.01, 2))
def test_a_twist_held_for_a_while_is_its_arc(forward: float, left: float, yaw: float, dt_s: float) -> None:
    motion = Twist2(forward, left, yaw).after(dt_s)

    assume(abs(yaw * dt_s) < 3.0)
    np.testing.assert_allclose(motion.log(), (forward * dt_s, left * dt_s, yaw * dt_s), rtol=1e-6, atol=1e-7)


def test_a_covariance_in_axes_a_quarter_turn_away_swaps_forward_and_left() -> None:
    covariance = np.array([[4.0, 0.5, 0.2], [0.5, 1.0, -0.3], [0.2, -0.3, 0.1]])

    turned = rotate_axes(covariance, math.pi / 2)

    np.testing.assert_allclose(turned, [[1.0, -0.5, 0.3], [-0.5, 4.0, 0.2], [0.3, 0.2, 0.1]], atol=1e-15)
    np.testing.assert_array_equal(turned, turned.T)
