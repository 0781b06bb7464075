"""Mountings: intrinsic z-y-x angles, as in REP-103."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.errors import ShapeError
from trailmark.geometry import Pose2, Pose3

lengths = st.floats(-10.0, 10.0)
turns = st.floats(-3.1, 3.1)
poses = st.builds(Pose3, lengths, lengths, lengths, turns, st.floats(-1.5, 1.5), turns)


def assert_same_motion(left: Pose3, right: Pose3, atol: float = 1e-9) -> None:
    np.testing.assert_allclose(left.matrix(), right.matrix(), atol=atol)


def test_a_camera_pitched_down_looks_at_the_ground() -> None:
    pose_base_camera = Pose3(x=0.2, z=0.5, pitch=math.radians(90))

    np.testing.assert_allclose(pose_base_camera.transform(np.array([0.5, 0.0, 0.0])), [0.2, 0.0, 0.0], atol=1e-12)


def test_yaw_is_applied_first_then_pitch_then_roll() -> None:
    # forward, after a yaw to the left and a pitch down, looks down; left has become backwards
    rotation = Pose3(yaw=math.pi / 2, pitch=math.pi / 2).rotation()

    np.testing.assert_allclose(rotation @ [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], atol=1e-12)
    np.testing.assert_allclose(rotation @ [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], atol=1e-12)


@given(poses)
def test_rotations_are_proper(pose: Pose3) -> None:
    rotation = pose.rotation()

    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


@given(poses)
def test_a_matrix_gives_its_pose_back(pose: Pose3) -> None:
    found = Pose3.from_matrix(pose.matrix())

    np.testing.assert_allclose(
        [found.x, found.y, found.z, found.roll, found.pitch, found.yaw],
        [pose.x, pose.y, pose.z, pose.roll, pose.pitch, pose.yaw],
        atol=1e-7,
    )


@given(poses)
def test_a_pose_and_its_inverse_cancel(pose: Pose3) -> None:
    assert_same_motion(pose @ pose.inverse(), Pose3())


@given(poses, poses)
def test_composition_is_the_product_of_matrices(a: Pose3, b: Pose3) -> None:
    np.testing.assert_allclose((a @ b).matrix(), a.matrix() @ b.matrix(), atol=1e-7)


@pytest.mark.parametrize("pitch", [math.pi / 2, -math.pi / 2])
@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
@pytest.mark.parametrize("roll", [0.0, 0.4])
def test_straight_up_and_down_keep_their_rotation(pitch: float, yaw: float, roll: float) -> None:
    pose = Pose3(1.0, 2.0, 3.0, roll, pitch, yaw)

    found = Pose3.from_matrix(pose.matrix())

    assert_same_motion(found, pose)
    assert found.roll == 0.0


@given(poses, st.lists(st.tuples(lengths, lengths, lengths), min_size=1, max_size=5))
def test_points_move_as_by_the_matrix(pose: Pose3, points: list[tuple[float, float, float]]) -> None:
    array = np.array(points)
    expected = (pose.matrix() @ np.column_stack([array, np.ones(len(array))]).T).T[:, :3]

    np.testing.assert_allclose(pose.transform(array), expected, atol=1e-9)


def test_planar_poses_come_and_go() -> None:
    pose = Pose2(1.0, -2.0, 0.5)

    assert Pose3.from_planar(pose, z=0.3).planar() == pose
    assert Pose3.from_planar(pose, z=0.3) == Pose3(1.0, -2.0, 0.3, 0.0, 0.0, 0.5)


@given(
    st.builds(Pose2, lengths, lengths, turns),
    st.builds(Pose2, lengths, lengths, turns),
)
def test_level_poses_compose_as_planar_ones(a: Pose2, b: Pose2) -> None:
    assert_same_motion(Pose3.from_planar(a) @ Pose3.from_planar(b), Pose3.from_planar(a @ b))


def test_what_is_no_pose_is_refused() -> None:
    with pytest.raises(ValueError, match="pose is not finite"):
        Pose3(roll=math.nan)
    with pytest.raises(ShapeError, match=r"shape \(4, 4\)"):
        Pose3.from_matrix(np.eye(3))
