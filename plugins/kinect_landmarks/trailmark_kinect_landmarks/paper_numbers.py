"""The numbers of Eqs. (7)-(16) for the two landmarks that span the picture, by the paper's names."""

from __future__ import annotations

import math

import numpy as np

from trailmark.geometry import Pose2
from trailmark_kinect_landmarks.camera import LandmarkCamera
from trailmark_kinect_landmarks.landmarks import SeenLandmarks
from trailmark_kinect_landmarks.triangulation import abscissa, epsilon

__all__ = ["paper_numbers"]


def paper_numbers(seen: SeenLandmarks, pose_start_base: Pose2, camera: LandmarkCamera) -> dict[str, float]:
    """Return them for A, the leftmost landmark, and B, the rightmost.

    Parameters
    ----------
    seen : SeenLandmarks
        Landmarks that agree with the pose, at least two.
    pose_start_base : Pose2
        Base as seen from the start.
    """
    points = camera.in_camera(seen.points_base)  # x forward, y left, z up
    bearings = np.arctan2(points[:, 1], points[:, 0])
    numbers: dict[str, float] = {}
    for name, row in (("A", int(bearings.argmax())), ("B", int(bearings.argmin()))):
        dV, left, dy = (float(value) for value in points[row])
        alpha, beta = math.atan2(-left, dV), math.atan2(dy, dV)
        dM = dV if camera.depth_kind == "z" else math.hypot(dV, left)
        numbers |= {f"alpha_{name}": alpha, f"beta_{name}": beta, f"dM_{name}": dM}
        numbers |= {f"dx_{name}": -left, f"dV_{name}": dV, f"dy_{name}": dy}
    line = abscissa(numbers["dx_A"], numbers["dV_A"], numbers["dx_B"], numbers["dV_B"])
    numbers |= {"AB": line.AB, "omega": line.omega, "Dir": line.Dir}
    return numbers | {
        "epsilon": epsilon(pose_start_base),
        "epsilon_x": pose_start_base.x,
        "epsilon_y": pose_start_base.y,
    }
