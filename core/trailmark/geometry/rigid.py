"""Rigid motions from pairs of points, by least squares in closed form; the scale is fixed to 1.

Everywhere ``points_a = R_a_b points_b + t_a_b``, points one per row, row by row the same point.
"""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import ShapeError
from trailmark.geometry.se2 import Pose2

__all__ = ["fit_pose2", "kabsch"]


def kabsch(points_a: Floats, points_b: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Return R, t that minimise the weighted squares of ``points_a - R points_b - t``, in any dimension.

    Kabsch 1976, with the sign of Umeyama 1991: always a rotation, never a reflection.

    Parameters
    ----------
    points_a, points_b : (..., N, D) float64
        Pairs; batches in front [any unit of length].
    weights : (..., N) float64
        One of each pair, not all 0.

    Returns
    -------
    R : (..., D, D) float64
        Rotation.
    t : (..., D) float64
        Translation, in the unit of the points.

    Raises
    ------
    ShapeError
        If the shapes do not fit.
    """
    if points_a.shape != points_b.shape or weights.shape != points_a.shape[:-1]:
        raise ShapeError(f"{points_a.shape} and {points_b.shape} points with {weights.shape} weights are no pairs")
    share = weights / weights.sum(axis=-1, keepdims=True)
    mean_a = np.einsum("...n,...nd->...d", share, points_a)
    mean_b = np.einsum("...n,...nd->...d", share, points_b)
    from_a, from_b = points_a - mean_a[..., None, :], points_b - mean_b[..., None, :]
    U, _, Vt = np.linalg.svd(np.einsum("...n,...ni,...nj->...ij", share, from_a, from_b))
    sign = np.ones(U.shape[:-1])
    sign[..., -1] = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    R = np.einsum("...ij,...j,...jk->...ik", U, sign, Vt)
    return R, mean_a - np.einsum("...ij,...j->...i", R, mean_b)


def fit_pose2(points_a: Floats, points_b: Floats) -> Pose2:
    """Return the pose of b as seen from a with the least squares of ``points_a - pose_a_b @ points_b``.

    In the plane the turn is the angle of one summed vector, so two different points, or a straight line, are enough:

        theta = atan2(sum b'_i x a'_i, sum b'_i . a'_i),  a' and b' relative to their means

    Parameters
    ----------
    points_a, points_b : (N, 2) float64
        Pairs, at least one [any unit of length]. Where all points of one side coincide nothing tells the turn;
        it is then 0.

    Raises
    ------
    ShapeError
        If they are no pairs of points in the plane.
    """
    if points_a.ndim != 2 or points_a.shape[1] != 2 or points_a.shape != points_b.shape or not len(points_a):
        raise ShapeError(f"points must be pairs of shape (N, 2), not {points_a.shape} and {points_b.shape}")
    mean_a, mean_b = points_a.mean(axis=0), points_b.mean(axis=0)
    a, b = points_a - mean_a, points_b - mean_b
    theta = math.atan2(float(np.sum(b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0])), float(np.sum(a * b)))
    cos, sin = math.cos(theta), math.sin(theta)
    x = mean_a[0] - (cos * mean_b[0] - sin * mean_b[1])
    y = mean_a[1] - (sin * mean_b[0] + cos * mean_b[1])
    return Pose2(float(x), float(y), theta)
