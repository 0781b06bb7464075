"""How badly places that one localizer tells agree with the way that the motion of another makes, at each time shift.

The way drifts: an error of a turn moves all that comes after it aside. So what is left between places and way is no
white noise, and an offset that explains it is none. Generalized least squares with the covariance of that drift
(the random walks that the motion states, and a yaw rate that is a little wrong) tells the two apart.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats

Complexes: TypeAlias = npt.NDArray[np.complex128]

__all__ = ["cost_beside_drift", "cost_of_places"]

# By which yaw rate an honest odometry is wrong, one standard deviation [rad/s].
_YAW_RADPS = math.radians(0.3)
_LEAST_M2 = 1e-6
_LEAST_POWER = 1e-6
# Localizers state their drift wrongly: of these factors of its variance the largest counts that is as likely as the
# likeliest, by -2 log likelihood.
_SCALES, _AS_LIKELY = (100.0, 10.0, 1.0, 0.1, 0.01), 4.0


def cost_of_places(told: Complexes, expected: Complexes) -> Floats:
    """Return how badly places, (N,), agree with a way, (S, N), laid over them at each shift, as if it did not drift.

    In complex numbers a similarity is a product and a sum, so this is cheap. An offset that it does not show is none;
    one that it does show may be drift.
    """
    told = told - told.mean()
    expected = expected - expected.mean(axis=1, keepdims=True)
    power = np.maximum((np.abs(expected) ** 2).sum(axis=1), _LEAST_POWER)
    misfit = (np.abs(told) ** 2).sum() - np.abs((told * expected.conj()).sum(axis=1)) ** 2 / power
    dof = 2.0 * len(told) - 4.0
    return np.asarray(misfit * dof / max(float(misfit.min()), _LEAST_POWER**2))


def cost_beside_drift(rows: Floats, way: Floats) -> Floats:
    """Return how badly places agree with a way that drifts, laid over them at each shift, (S,), in chi squares.

    Turned, moved and scaled as fits best, so that neither the start of the odometry nor the radius of its wheels
    matters. Scaled so that the lowest is no more than is to be expected.

    Parameters
    ----------
    rows : (N, 3) float64
        Places x, y, and the variance of each [m, m, m^2].
    way : (S, N, 5) float64
        Where the way is at the stamps of the places, less each shift: stamp, x, y, and the variances of position and
        heading that motion has added since its beginning [s, m, m, m^2, rad^2].
    """
    n = len(rows)
    middle = way[len(way) // 2]
    # The places are turned onto the way: of what is measured, only the way changes with the shift.
    x, y = rows[:, 0] - rows[:, 0].mean(), rows[:, 1] - rows[:, 1].mean()
    one, none = np.ones(n), np.zeros(n)
    similarity = np.column_stack([np.concatenate(pair) for pair in ((x, y), (-y, x), (one, none), (none, one))])
    at = np.concatenate([way[:, :, 1] - middle[:, 1].mean(), way[:, :, 2] - middle[:, 2].mean()], axis=1)
    walk, bias = _drift_of(middle)
    noise = np.outer(bias, bias) + np.diag(np.tile(np.maximum(rows[:, 2], _LEAST_M2), 2))
    fits = [_fit(at, similarity, noise + scale * walk) for scale in _SCALES]
    likeliest = min(improbability for _, improbability in fits)
    costs = next(costs for costs, improbability in fits if improbability < likeliest + _AS_LIKELY)
    return costs / max(1.0, float(costs.min()) / (2.0 * n - 4.0))


def _fit(at: Floats, similarity: Floats, covariance: Floats) -> tuple[Floats, float]:
    """Return the chi squares at each shift, and -2 log likelihood of the best, to a constant."""
    root = np.linalg.cholesky(covariance)
    basis, triangle = np.linalg.qr(np.linalg.solve(root, similarity))
    whitened = np.linalg.solve(root, at.T)
    misses = whitened - basis @ (basis.T @ whitened)
    costs = (misses**2).sum(axis=0)
    # Restricted likelihood: four numbers were fitted.
    log_det = np.log(root.diagonal()).sum() + np.log(np.abs(triangle.diagonal())).sum()
    return costs, 2.0 * float(log_det) + float(costs.min())


def _drift_of(way: Floats) -> tuple[Floats, Floats]:
    """Return the covariance of the random walk of a way, (2 N, 2 N), and what a wrong yaw rate adds, (2 N,).

    All x, then all y, at N instants.
    """
    n = len(way)
    is_later = np.tril(np.ones((n, n)))
    dt_s, added_m2, added_rad2 = (np.diff(way[:, column], prepend=way[0, column]) for column in (0, 3, 4))
    # A turn by a small angle at k moves the place at i by the arm between the two, turned by 90 deg.
    arms = np.concatenate(
        [
            -(way[:, np.newaxis, 2] - way[np.newaxis, :, 2]) * is_later,
            (way[:, np.newaxis, 1] - way[np.newaxis, :, 1]) * is_later,
        ]
    )
    turns = arms * np.sqrt(np.maximum(added_rad2, 0.0))
    bias = _YAW_RADPS * (arms @ dt_s)
    walk = is_later * np.maximum(added_m2, 0.0) @ is_later.T
    drift: Floats = turns @ turns.T
    drift[:n, :n] += walk
    drift[n:, n:] += walk
    return drift, bias
