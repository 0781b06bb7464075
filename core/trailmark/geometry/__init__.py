"""Planar and spatial poses, twists and trajectories."""

from trailmark.geometry.se2 import Pose2, Twist2, rotate_axes, wrap_angle, wrap_angles
from trailmark.geometry.se3 import Pose3
from trailmark.geometry.trajectory import Trajectory
from trailmark.geometry.tum import read_tum, write_tum

__all__ = [
    "Pose2",
    "Pose3",
    "Trajectory",
    "Twist2",
    "read_tum",
    "rotate_axes",
    "wrap_angle",
    "wrap_angles",
    "write_tum",
]
