"""filterpy's unscented Kalman filter, with angles that wrap: the choice where the belief is wide and the path bends."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from trailmark.estimation.kalman.ekf import Moves
from trailmark.estimation.kalman.innovation import Innovation, Measures
from trailmark.geometry import wrap_angle

__all__ = ["Ukf"]

Array = npt.NDArray[np.float64]

# Sigma points near the mean: those of an unknown heading must not go all round the circle.
_ALPHA, _BETA, _KAPPA = 0.3, 2.0, 0.0


class Ukf:
    """Predicts and updates like `Ekf`, through sigma points instead of derivatives.

    A measurement is predicted as its innovation at each sigma point, whose angles are wrapped before they are weighed
    with others. Its gate is that of the EKF: the same linear innovation.
    """

    def __init__(self, n: int) -> None:
        self._points = MerweScaledSigmaPoints(n, _ALPHA, _BETA, _KAPPA, sqrt_method=_root, subtract=_difference)
        self._kalman: Any = UnscentedKalmanFilter(  # filterpy has no types
            dim_x=n,
            dim_z=3,
            dt=1.0,
            hx=_as_it_is,
            fx=_as_it_is,
            points=self._points,
            x_mean_fn=_mean,
            residual_x=_difference,
            state_add=_sum,
        )

    def moved(self, x: Array, covariance: Array, moves: Moves) -> tuple[Array, Array]:
        """Return state and covariance after a motion."""
        kalman = self._kalman
        kalman.x, kalman.P, kalman.Q = x, covariance, moves.noise
        forward_m, left_m, turn_rad = moves.step
        rest = moves.x - moves.jacobian @ x  # what is linear in the state beside the pose, and exact so

        def carried(point: Array, dt_s: float) -> Array:
            ahead = moves.jacobian @ point + rest
            extra = moves.jacobian[:3, 3:] @ (point[3:] - x[3:])
            cos, sin = math.cos(point[2]), math.sin(point[2])
            ahead[0] = point[0] + cos * forward_m - sin * left_m + extra[0]
            ahead[1] = point[1] + sin * forward_m + cos * left_m + extra[1]
            ahead[2] = wrap_angle(float(point[2] + turn_rad + extra[2]))
            return ahead

        kalman.predict(fx=carried)
        return _wrapped(kalman.x), _symmetric(kalman.P)

    def corrected(self, x: Array, covariance: Array, seen: Innovation, measures: Measures) -> tuple[Array, Array]:
        """Return state and covariance after a measurement of unit noise."""
        kalman, k = self._kalman, len(seen.innovation)
        kalman.x, kalman.P = x, covariance
        kalman.sigmas_f = self._points.sigma_points(x, covariance)

        def predicted(point: Array) -> Array:
            return -seen.scale * measures.innovation(point)[0]

        kalman.update(np.zeros(k), R=np.eye(k), hx=predicted)
        return _wrapped(kalman.x), _symmetric(kalman.P)


def _as_it_is(x: Array, dt_s: float = 0.0) -> Array:
    return x


def _root(covariance: Array) -> Array:
    """Return ``U`` with ``U^T U`` the covariance; to rounding, it may be singular."""
    try:
        return np.asarray(np.linalg.cholesky(covariance).T)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(covariance)
        return np.asarray((vectors * np.sqrt(np.clip(values, 0.0, None))).T)


def _difference(a: Array, b: Array) -> Array:
    difference = a - b
    difference[2] = wrap_angle(float(difference[2]))
    return difference


def _sum(a: Array, b: Array) -> Array:
    return _wrapped(a + b)


def _mean(points: Array, weights: Array) -> Array:
    """Return the weighted mean; of angles that of their differences from the first."""
    centre = points[0]
    differences = points - centre
    turns = differences[:, 2]
    differences[:, 2] = turns - 2.0 * math.pi * np.round(turns / (2.0 * math.pi))
    return _wrapped(centre + weights @ differences)


def _wrapped(x: Array) -> Array:
    x[2] = wrap_angle(float(x[2]))
    return x


def _symmetric(covariance: Array) -> Array:
    return (covariance + covariance.T) / 2.0
