"""An extended Kalman filter: predicted by filterpy, updated here."""

from __future__ import annotations

from typing import Any

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

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

    filterpy predicts; it does not update. It makes x of shape (n, 1), and a measurement of shape (m,) then silently
    broadcasts it to (n, n): x is of shape (n,) here, always, and shapes are checked. It wraps no state and gates
    nothing: both are done around it. Its ``update`` inverts S anew, with scipy, and copies what nobody reads; `update`
    is the same update (Joseph form) with the S that the gate has computed, in a third of the time; a test compares
    the two.
    """

    def __init__(self, n: int) -> None:
        self._kalman: Any = ExtendedKalmanFilter(dim_x=n, dim_z=3)  # filterpy has no types
        self._kalman.predict_x = self._take  # the moved state is the motion model's, not F x
        self._unit = np.eye(n)

    def predict(self, x: Floats, covariance: Floats, motion: PredictedMotion) -> tuple[Floats, Floats]:
        """Return state and covariance after a motion: ``F P F^T + Q``."""
        kalman = self._kalman
        kalman.P, kalman.F, kalman.Q = covariance, motion.jacobian, motion.noise
        kalman.predict(motion.x)
        return kalman.x, kalman.P

    def update(self, x: Floats, covariance: Floats, seen: Innovation, model: MeasurementModel) -> tuple[Floats, Floats]:
        """Return state and covariance after a measurement of unit noise, given its innovation."""
        gain = seen.cross @ seen.inverse
        updated = x + gain @ seen.innovation
        kept = self._unit - gain @ seen.jacobian
        updated[2] = wrap_angle(float(updated[2]))
        return updated, kept @ covariance @ kept.T + gain @ gain.T

    def _take(self, moved: Floats) -> None:
        self._kalman.x = moved
