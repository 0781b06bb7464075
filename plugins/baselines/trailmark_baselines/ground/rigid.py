"""Rigid motions of the plane from pairs of points, the scale fixed to 1."""

from __future__ import annotations

import cv2
import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.geometry import Pose2
from trailmark.geometry.rigid import fit_pose2

__all__ = ["alignment_covariance", "ransac_rigid"]


def ransac_rigid(points_a: Floats, points_b: Floats, tolerance: float) -> tuple[Pose2, Bools] | None:
    """Return the pose of b as seen from a and which pairs agree, (N,) bool; None when no motion is found.

    RANSAC over similarities (OpenCV's, always with the same seed); those that agree are fitted rigidly, twice, the
    second time those that agree with the first fit.

    Parameters
    ----------
    points_a, points_b : (N, 2) float64
        Pairs.
    tolerance : float
        Largest distance of a pair that agrees, in the unit of the points.
    """
    if len(points_a) < 3:
        return None
    _, mask = cv2.estimateAffinePartial2D(
        points_b, points_a, method=cv2.RANSAC, ransacReprojThreshold=tolerance, maxIters=500, confidence=0.995
    )
    if mask is None:
        return None
    agree = np.asarray(mask, np.uint8).ravel().astype(bool)
    for _ in range(2):
        if agree.sum() < 3:
            return None
        pose = fit_pose2(points_a[agree], points_b[agree])
        agree = np.hypot(*(points_a - pose @ points_b).T) <= tolerance
    return pose, agree


def alignment_covariance(points_a: Floats, pose_a_b: Pose2, points_b: Floats, least_sigma: float) -> Floats:
    """Return the covariance (3, 3) of a fitted pose (x, y, theta), from what its pairs leave.

    Parameters
    ----------
    points_a, points_b : (N, 2) float64
        The pairs that it was fitted to.
    least_sigma : float
        Standard deviation that one coordinate has at least, in the unit of the points.
    """
    fitted = pose_a_b @ points_b
    turned = fitted - (pose_a_b.x, pose_a_b.y)
    residuals = points_a - fitted
    n = len(points_a)
    variance = max(float(np.sum(residuals**2)) / max(1, 2 * n - 3), least_sigma**2)
    J = np.zeros((n, 2, 3))
    J[:, 0, 0] = J[:, 1, 1] = 1.0
    J[:, 0, 2], J[:, 1, 2] = -turned[:, 1], turned[:, 0]
    return np.asarray(variance * np.linalg.inv(np.einsum("nij,nik->jk", J, J)))
