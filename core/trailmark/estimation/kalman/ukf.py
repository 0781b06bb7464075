"""filterpy's unscented Kalman filter, with angles that wrap: the choice where the belief is wide and the path bends."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from trailmark.arrays import Floats
from trailmark.estimation.kalman.ekf import PredictedMotion
from trailmark.estimation.kalman.innovation import Innovation, MeasurementModel
from trailmark.geometry import wrap_angle

__all__ = ["Ukf"]

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
            hx=_identity,
            fx=_identity,
            points=self._points,
            x_mean_fn=_mean,
            residual_x=_difference,
            state_add=_sum,
        )

    def predict(self, x: Floats, covariance: Floats, motion: PredictedMotion) -> tuple[Floats, Floats]:
        """Return state and covariance after a motion."""
        kalman = self._kalman
        kalman.x, kalman.P, kalman.Q = x, covariance, motion.noise
        forward_m, left_m, turn_rad = motion.step
        rest = motion.x - motion.jacobian @ x  # what is linear in the state beside the pose, and exact so

        def carried(point: Floats, dt_s: float) -> Floats:
            ahead = motion.jacobian @ point + rest
            extra = motion.jacobian[:3, 3:] @ (point[3:] - x[3:])
            cos, sin = math.cos(point[2]), math.sin(point[2])
            ahead[0] = point[0] + cos * forward_m - sin * left_m + extra[0]
            ahead[1] = point[1] + sin * forward_m + cos * left_m + extra[1]
            ahead[2] = wrap_angle(float(point[2] + turn_rad + extra[2]))
            return ahead

        kalman.predict(fx=carried)
        return _with_wrapped_heading(kalman.x), _symmetric(kalman.P)

    def update(self, x: Floats, covariance: Floats, seen: Innovation, model: MeasurementModel) -> tuple[Floats, Floats]:
        """Return state and covariance after a measurement of unit noise."""
        kalman, k = self._kalman, len(seen.innovation)
        kalman.x, kalman.P = x, covariance
        kalman.sigmas_f = self._points.sigma_points(x, covariance)

        def predicted(point: Floats) -> Floats:
            return -seen.scale * model.innovation(point)[0]

        kalman.update(np.zeros(k), R=np.eye(k), hx=predicted)
        return _with_wrapped_heading(kalman.x), _symmetric(kalman.P)


def _identity(x: Floats, dt_s: float = 0.0) -> Floats:
    return x


def _root(covariance: Floats) -> Floats:
    """Return ``U`` with ``U^T U`` the covariance; to rounding, it may be singular."""
    try:
        return np.asarray(np.linalg.cholesky(covariance).T)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(covariance)
        return np.asarray((vectors * np.sqrt(np.clip(values, 0.0, None))).T)


def _difference(a: Floats, b: Floats) -> Floats:
    difference = a - b
    difference[2] = wrap_angle(float(difference[2]))
    return difference


def _sum(a: Floats, b: Floats) -> Floats:
    return _with_wrapped_heading(a + b)


def _mean(points: Floats, weights: Floats) -> Floats:
    """Return the weighted mean; of angles that of their differences from the first."""
    centre = points[0]
    differences = points - centre
    turns = differences[:, 2]
    differences[:, 2] = turns - 2.0 * math.pi * np.round(turns / (2.0 * math.pi))
    return _with_wrapped_heading(centre + weights @ differences)


def _with_wrapped_heading(x: Floats) -> Floats:
    x[2] = wrap_angle(float(x[2]))
    return x


def _symmetric(covariance: Floats) -> Floats:
    return (covariance + covariance.T) / 2.0
