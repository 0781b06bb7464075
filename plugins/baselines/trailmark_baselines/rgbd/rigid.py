"""Rigid motion between two sets of points: Kabsch's alignment inside RANSAC."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["kabsch", "ransac_rigid"]

Array = npt.NDArray[np.float64]

_N_REFITS = 3


def kabsch(points_a: Array, points_b: Array, weights: Array) -> tuple[Array, Array]:
    """Return R, t that minimise the weighted squares of ``points_a - R points_b - t``.

    Parameters
    ----------
    points_a, points_b : (..., N, 3) float
        Row by row the same point; batches in front [m].
    weights : (..., N) float
        Weights, not all 0.
    """
    share = weights / weights.sum(axis=-1, keepdims=True)
    mean_a = np.einsum("...n,...nd->...d", share, points_a)
    mean_b = np.einsum("...n,...nd->...d", share, points_b)
    from_a, from_b = points_a - mean_a[..., None, :], points_b - mean_b[..., None, :]
    U, _, Vt = np.linalg.svd(np.einsum("...n,...ni,...nj->...ij", share, from_a, from_b))
    sign = np.ones(U.shape[:-1])
    sign[..., -1] = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    R = np.einsum("...ij,...j,...jk->...ik", U, sign, Vt)
    return R, mean_a - np.einsum("...ij,...j->...i", R, mean_b)


def ransac_rigid(
    points_a: Array, points_b: Array, tolerance_m: Array, rng: np.random.Generator, n_tries: int
) -> tuple[Array, Array, npt.NDArray[np.bool_]] | None:
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
