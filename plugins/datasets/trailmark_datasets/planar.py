"""Camera poses in space, seen as poses of base in the plane of the one that a run begins with."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.config import Mounting
from trailmark.geometry import Pose3, Trajectory
from trailmark.sources.frame_tree import R_SENSOR_OPTICAL

__all__ = ["covered_stamps", "interpolated_poses", "mounting_pose", "planar_trajectory"]


_SAME_INSTANT_S = 1e-6
# Stamps of the same instant: lists have six decimals, files of true poses four.
_SAME_STAMP_S = 1e-4


def mounting_pose(mounting: Mounting | None) -> Pose3:
    """Return `pose_base_sensor` of a mounting as the config gives it; None: the sensor is base."""
    if mounting is None:
        return Pose3()
    roll, pitch, yaw = (math.radians(deg) for deg in (mounting.roll_deg, mounting.pitch_deg, mounting.yaw_deg))
    return Pose3(mounting.x, mounting.y, mounting.z, roll, pitch, yaw)


def planar_trajectory(
    stamps_s: Floats, poses_world_camera: Floats, pose_base_sensor: Pose3, begin_s: float | None = None
) -> Trajectory:
    """Project camera poses to the plane of the base pose that a run begins with.

    A localizer begins in the plane of the first picture that it is given. Where the camera tilts, no alignment in the
    plane mends a projection to another one.

    ``T_first_i = inv(T_world_camera_0 T_camera_base) T_world_camera_i T_camera_base``; x and y are its
    translation, theta the heading of its x axis. With the camera itself as base this is x along the first
    optical axis, y to its left, and the yaw relative to the first camera pose.

    Parameters
    ----------
    stamps_s : (N,) float
        Stamps, strictly increasing [s].
    poses_world_camera : (N, 4, 4) float
        Poses of the camera's optical frame in any world.
    pose_base_sensor : Pose3
        Mounting of the camera.
    begin_s : float, optional
        The first pose is the first one from this stamp on; default: the first of all [s].
    """
    T_base_camera = pose_base_sensor.matrix()
    T_base_camera[:3, :3] = T_base_camera[:3, :3] @ R_SENSOR_OPTICAL
    T_world_base = poses_world_camera @ np.linalg.inv(T_base_camera)
    if len(T_world_base):
        later = stamps_s >= (-math.inf if begin_s is None else begin_s - _SAME_INSTANT_S)
        first = int(np.argmax(later)) if later.any() else len(stamps_s) - 1
        T_first_base = np.linalg.inv(T_world_base[first]) @ T_world_base
    else:
        T_first_base = T_world_base
    headings = np.arctan2(T_first_base[:, 1, 0], T_first_base[:, 0, 0])
    return Trajectory(stamps_s, np.column_stack([T_first_base[:, 0, 3], T_first_base[:, 1, 3], headings]))


def covered_stamps(wanted_s: Floats, truth_s: Floats, max_gap_s: float) -> npt.NDArray[np.bool_]:
    """Return which stamps have a true pose of their own, or lie between two that are close enough together."""
    if len(truth_s) < 2:
        return np.zeros(len(wanted_s), dtype=np.bool_)
    after = np.clip(np.searchsorted(truth_s, wanted_s), 1, len(truth_s) - 1)
    inside = (wanted_s >= truth_s[0]) & (wanted_s <= truth_s[-1])
    nearest_s = np.minimum(np.abs(truth_s[after] - wanted_s), np.abs(truth_s[after - 1] - wanted_s))
    is_bridged = truth_s[after] - truth_s[after - 1] <= max_gap_s
    return np.asarray(inside & (is_bridged | (nearest_s <= _SAME_STAMP_S)))


def interpolated_poses(wanted_s: Floats, truth_s: Floats, poses: Floats) -> Floats:
    """Return homogeneous (M, 4, 4) poses between rows x y z qx qy qz qw (N, 7): straight lines, shortest rotations."""
    from scipy.spatial.transform import Rotation, Slerp

    matrices = np.tile(np.eye(4), (len(wanted_s), 1, 1))
    if len(wanted_s):
        matrices[:, :3, :3] = Slerp(truth_s, Rotation.from_quat(poses[:, 3:]))(wanted_s).as_matrix()
        matrices[:, :3, 3] = np.column_stack([np.interp(wanted_s, truth_s, column) for column in poses[:, :3].T])
    return matrices
