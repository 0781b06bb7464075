"""An extended Kalman filter: the sums of filterpy, without what it keeps of them."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.innovation import Innovation, MeasurementModel
from trailmark.geometry import wrap_angle

__all__ = ["Ekf", "PredictedMotion"]


class PredictedMotion:
    """A motion as the filters need it: to the first order about one state, and from any state.

    Attributes
    ----------
    x : (n,) float64
        The moved state.
    jacobian : (n, n) float64
        How it changes with the state before.
    noise : (n, n) float64
        Covariance of the motion.
    step : (float, float, float)
        Base after the motion as seen from base before it [m, m, rad].
    """

    __slots__ = ("jacobian", "noise", "step", "x")

    def __init__(self, x: Floats, jacobian: Floats, noise: Floats, step: tuple[float, float, float]) -> None:
        self.x, self.jacobian, self.noise, self.step = x, jacobian, noise, step


class Ekf:
    """Predicts and updates (x, y, theta, ...), from and to values that the caller keeps.

    The prediction is that of filterpy to the last bit, the update (Joseph form) is the same with the S that the gate
    has computed; tests compare both. filterpy itself takes three times as long, because it copies what nobody reads
    and inverts S anew; its import takes most of a second.
    """

    def __init__(self, n: int) -> None:
        self._unit = np.eye(n)

    def predict(self, x: Floats, covariance: Floats, motion: PredictedMotion) -> tuple[Floats, Floats]:
        """Return state and covariance after a motion: ``F P F^T + Q``."""
        jacobian = motion.jacobian
        return motion.x, jacobian.dot(covariance).dot(jacobian.T) + motion.noise

    def update(self, x: Floats, covariance: Floats, seen: Innovation, model: MeasurementModel) -> tuple[Floats, Floats]:
        """Return state and covariance after a measurement of unit noise, given its innovation."""
        gain = seen.gain()
        updated = x + gain.dot(seen.innovation)
        kept = self._unit - gain.dot(seen.jacobian)
        updated[2] = wrap_angle(float(updated[2]))
        return updated, kept.dot(covariance).dot(kept.T) + gain.dot(gain.T)
