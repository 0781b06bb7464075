"""Camera poses in the plane of the first."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.config import Mounting
from trailmark.geometry import Pose2, Pose3
from trailmark.sources.frame_tree import R_SENSOR_OPTICAL as OPTICAL
from trailmark_datasets.planar import mounting_pose, planar_trajectory

ANGLES = st.floats(-3.0, 3.0)


HERE = Pose3()


def optical(pose_world_base: Pose3, pose_base_sensor: Pose3 = HERE) -> np.ndarray:
    """Return the pose of the optical frame of a camera on a robot."""
    matrix = pose_world_base.matrix() @ pose_base_sensor.matrix()
    matrix[:3, :3] = matrix[:3, :3] @ OPTICAL
    return matrix


def test_the_optical_axes_are_those_of_rep_103():
    np.testing.assert_array_equal(OPTICAL @ [0, 0, 1], [1, 0, 0])  # the view goes forward
    np.testing.assert_array_equal(OPTICAL @ [1, 0, 0], [0, -1, 0])  # right in the picture is right
    np.testing.assert_array_equal(OPTICAL @ [0, 1, 0], [0, 0, -1])  # down in the picture is down


def test_forward_left_and_yaw_of_a_camera_are_those_of_its_first_pose():
    """By hand: camera axes are the world's, z forward; it moves 2 ahead and 1 to its left and turns left by 30 deg."""
    first, second = np.eye(4), np.eye(4)
    second[:3, 3] = -1.0, 0.3, 2.0  # x right, y down, z forward
    turn = math.radians(30)  # left: about -y
    second[:3, :3] = [
        [math.cos(turn), 0, -math.sin(turn)],
        [0, 1, 0],
        [math.sin(turn), 0, math.cos(turn)],
    ]

    trajectory = planar_trajectory(np.array([0.0, 1.0]), np.stack([first, second]), Pose3())

    np.testing.assert_allclose(trajectory.poses, [[0, 0, 0], [2.0, 1.0, turn]], atol=1e-12)


@given(ANGLES, ANGLES, st.floats(-1.5, 1.5), ANGLES, ANGLES)
def test_the_world_the_camera_is_seen_from_does_not_matter(x, roll, pitch, yaw, turn):
    world = Pose3(x, 2.0, 3.0, roll, pitch, yaw).matrix()
    way = [Pose3(), Pose3(0.5, 0.2, 0.0, 0.0, 0.0, turn)]

    trajectory = planar_trajectory(np.array([0.0, 1.0]), np.stack([world @ optical(pose) for pose in way]), Pose3())

    np.testing.assert_allclose(trajectory.poses[1], [0.5, 0.2, turn], atol=1e-9)


@given(ANGLES, ANGLES)
def test_a_mounted_camera_tells_the_way_of_base(yaw, turn):
    mounting = Mounting.model_validate({"x": 0.3, "y": -0.1, "z": 1.0, "pitch_deg": 20, "yaw_deg": 45})
    base = [Pose2(1.0, 2.0, yaw), Pose2(1.0, 2.0, yaw) @ Pose2(0.4, -0.2, turn)]
    cameras = np.stack([optical(Pose3.from_planar(pose), mounting_pose(mounting)) for pose in base])

    trajectory = planar_trajectory(np.array([0.0, 1.0]), cameras, mounting_pose(mounting))

    np.testing.assert_allclose(trajectory.poses[1], [0.4, -0.2, turn], atol=1e-9)


def test_no_mounting_means_that_the_camera_is_base():
    assert mounting_pose(None) == Pose3()


def test_no_poses_make_an_empty_trajectory():
    assert len(planar_trajectory(np.empty(0), np.empty((0, 4, 4)), Pose3())) == 0


def test_degrees_of_a_mounting_become_radians():
    assert mounting_pose(Mounting.model_validate({"yaw_deg": 90})).yaw == pytest.approx(math.pi / 2)
