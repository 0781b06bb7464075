"""An extended Kalman filter: the arithmetic of one prediction and one update."""

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

    The arithmetic is filterpy's, and tests compare the two: the prediction is ``F P F^T + Q``, the update the Joseph
    form, with the S that the gate has computed. filterpy itself would invert S anew, with scipy, copy what nobody
    reads, and silently broadcast a measurement of shape (m,) to (n, n); and it takes a third of a second to import. It
    wraps no state and gates nothing: both are done around this.

    Parameters
    ----------
    n : int
        How many numbers the state has.
    """

    def __init__(self, n: int) -> None:
        self._unit = np.eye(n)

    def predict(self, x: Floats, covariance: Floats, motion: PredictedMotion) -> tuple[Floats, Floats]:
        """Return state and covariance after a motion: ``F P F^T + Q``."""
        return motion.x, motion.jacobian @ covariance @ motion.jacobian.T + motion.noise

    def update(self, x: Floats, covariance: Floats, seen: Innovation, model: MeasurementModel) -> tuple[Floats, Floats]:
        """Return state and covariance after a measurement of unit noise, given its innovation."""
        gain = seen.cross @ seen.inverse
        updated = x + gain @ seen.innovation
        kept = self._unit - gain @ seen.jacobian
        updated[2] = wrap_angle(float(updated[2]))
        return updated, kept @ covariance @ kept.T + gain @ gain.T
