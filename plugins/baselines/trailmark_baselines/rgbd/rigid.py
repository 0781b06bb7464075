"""Rigid motion between two sets of points: Kabsch's alignment inside RANSAC."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.geometry.rigid import kabsch

__all__ = ["ransac_rigid"]

_N_REFITS = 3


def ransac_rigid(
    points_a: Floats, points_b: Floats, tolerance_m: Floats, rng: np.random.Generator, n_tries: int
) -> tuple[Floats, Floats, Bools] | None:
    """Return R, t and which pairs agree; None with fewer than three pairs.

    Parameters
    ----------
    points_a, points_b : (N, 3) float
        Pairs, some of them wrong [m].
    tolerance_m : (N,) float
        Distance within which a pair agrees [m].
    n_tries : int
        Minimal sets.
    """
    n = len(points_a)
    if n < 3:
        return None
    sets = np.argsort(rng.random((n_tries, n)), axis=1)[:, :3]
    Rs, ts = kabsch(points_a[sets], points_b[sets], np.ones(sets.shape))
    misses = np.linalg.norm(points_a - np.einsum("hij,nj->hni", Rs, points_b) - ts[:, None], axis=2)
    best = int((misses < tolerance_m).sum(axis=1).argmax())
    inliers = misses[best] < tolerance_m
    R, t = Rs[best], ts[best]
    for _ in range(_N_REFITS):
        if inliers.sum() < 3:
            return None
        R, t = kabsch(points_a[inliers], points_b[inliers], 1.0 / tolerance_m[inliers] ** 2)
        inliers = np.linalg.norm(points_a - points_b @ R.T - t, axis=1) < tolerance_m
    return R, t, np.asarray(inliers)
