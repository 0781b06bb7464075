"""Rigid motions of the plane from pairs of points, the scale fixed to 1."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.geometry import Pose2

__all__ = ["alignment_covariance", "fit_rigid", "ransac_rigid", "transformed"]

Points = npt.NDArray[np.float64]


def transformed(pose: Pose2, points: Points) -> Points:
    """Return points (N, 2), seen from a frame at `pose`, as seen from outside."""
    cos, sin = math.cos(pose.theta), math.sin(pose.theta)
    return np.column_stack(
        [cos * points[:, 0] - sin * points[:, 1] + pose.x, sin * points[:, 0] + cos * points[:, 1] + pose.y]
    )


def fit_rigid(points_a: Points, points_b: Points) -> Pose2:
    """Return the pose of b as seen from a with the least squares ``points_a - pose @ points_b`` (Kabsch), (N, 2)."""
    mean_a, mean_b = points_a.mean(axis=0), points_b.mean(axis=0)
    a, b = points_a - mean_a, points_b - mean_b
    theta = math.atan2(float(np.sum(b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0])), float(np.sum(a * b)))
    cos, sin = math.cos(theta), math.sin(theta)
    x = mean_a[0] - (cos * mean_b[0] - sin * mean_b[1])
    y = mean_a[1] - (sin * mean_b[0] + cos * mean_b[1])
    return Pose2(float(x), float(y), theta)


def ransac_rigid(points_a: Points, points_b: Points, tolerance: float) -> tuple[Pose2, npt.NDArray[np.bool_]] | None:
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
        pose = fit_rigid(points_a[agree], points_b[agree])
        agree = np.hypot(*(points_a - transformed(pose, points_b)).T) <= tolerance
    return pose, agree


def alignment_covariance(points_a: Points, pose_a_b: Pose2, points_b: Points, least_sigma: float) -> Points:
    """Return the covariance (3, 3) of a fitted pose (x, y, theta), from what its pairs leave.

    Parameters
    ----------
    points_a, points_b : (N, 2) float64
        The pairs that it was fitted to.
    least_sigma : float
        Standard deviation that one coordinate has at least, in the unit of the points.
    """
    turned = transformed(pose_a_b, points_b) - np.array([pose_a_b.x, pose_a_b.y])
    residuals = points_a - np.array([pose_a_b.x, pose_a_b.y]) - turned
    n = len(points_a)
    variance = max(float(np.sum(residuals**2)) / max(1, 2 * n - 3), least_sigma**2)
    J = np.zeros((n, 2, 3))
    J[:, 0, 0] = J[:, 1, 1] = 1.0
    J[:, 0, 2], J[:, 1, 2] = -turned[:, 1], turned[:, 0]
    return np.asarray(variance * np.linalg.inv(np.einsum("nij,nik->jk", J, J)))
