"""SE(3): where a sensor is mounted."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import ShapeError
from trailmark.geometry.se2 import Pose2

__all__ = ["Pose3"]


@dataclass(frozen=True, slots=True)
class Pose3:
    """A pose in space, used for mountings: ``point_base = pose_base_sensor @ point_sensor``.

    Angles are intrinsic z-y-x (yaw, then pitch, then roll), as in REP-103.

    Attributes
    ----------
    x, y, z : float
        Position [m].
    roll, pitch, yaw : float
        Orientation [rad].
    """

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0

    def __post_init__(self) -> None:
        values = (self.x, self.y, self.z, self.roll, self.pitch, self.yaw)
        if not all(math.isfinite(value) for value in values):
            raise ValueError(f"pose is not finite: {values}")

    def rotation(self) -> Floats:
        """Return the (3, 3) rotation matrix ``R_a_b = Rz(yaw) Ry(pitch) Rx(roll)``."""
        cr, sr = math.cos(self.roll), math.sin(self.roll)
        cp, sp = math.cos(self.pitch), math.sin(self.pitch)
        cy, sy = math.cos(self.yaw), math.sin(self.yaw)
        return np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )

    def matrix(self) -> Floats:
        """Return the homogeneous (4, 4) matrix."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation()
        matrix[:3, 3] = self.x, self.y, self.z
        return matrix

    @classmethod
    def from_matrix(cls, matrix: npt.ArrayLike) -> Pose3:
        """Return the pose of a homogeneous (4, 4) matrix."""
        m = np.asarray(matrix, dtype=np.float64)
        if m.shape != (4, 4):
            raise ShapeError(f"a homogeneous matrix has shape (4, 4), not {m.shape}")
        pitch = math.asin(min(1.0, max(-1.0, -float(m[2, 0]))))
        if abs(m[2, 0]) > 1.0 - 1e-12:  # gimbal lock: only yaw -+ roll is defined, roll is set to zero
            yaw, roll = math.atan2(-m[0, 1], m[1, 1]), 0.0
        else:
            yaw, roll = math.atan2(m[1, 0], m[0, 0]), math.atan2(m[2, 1], m[2, 2])
        return cls(float(m[0, 3]), float(m[1, 3]), float(m[2, 3]), roll, pitch, yaw)

    def __matmul__(self, other: Pose3) -> Pose3:
        return Pose3.from_matrix(self.matrix() @ other.matrix())

    def inverse(self) -> Pose3:
        """Return ``pose_b_a`` of ``pose_a_b``."""
        rotation = self.rotation()
        matrix = np.eye(4)
        matrix[:3, :3] = rotation.T
        matrix[:3, 3] = -rotation.T @ np.array([self.x, self.y, self.z])
        return Pose3.from_matrix(matrix)

    def transform(self, points: Floats) -> Floats:
        """Return ``points_a`` of ``points_b``, both (N, 3) or (3,) [m]."""
        return np.asarray(points @ self.rotation().T + np.array([self.x, self.y, self.z]))

    def planar(self) -> Pose2:
        """Return the projection to the plane: x, y and yaw."""
        return Pose2(self.x, self.y, self.yaw)

    @classmethod
    def from_planar(cls, pose: Pose2, z: float = 0.0) -> Pose3:
        """Return the level pose at height `z` [m] above a planar one."""
        return cls(pose.x, pose.y, z, 0.0, 0.0, pose.theta)
