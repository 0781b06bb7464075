"""An extended Kalman filter: predicted by filterpy, updated here."""

from __future__ import annotations

from typing import Any

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from trailmark.arrays import Floats
from trailmark.estimation.kalman.innovation import Innovation, MeasurementModel
from trailmark.estimation.symmetric import Sym3, add, congruence, to_matrix
from trailmark.geometry import wrap_angle

__all__ = ["Ekf", "PredictedMotion"]


class PredictedMotion:
    """A motion as the filters need it: to the first order about one state, and from any state.

    Attributes
    ----------
    x : (n,) float64
        The moved state.
    in_plane : (float, float, Sym3) or None
        Of a state that is a pose alone, how far it moves along the axes of the map, and the noise: all that the
        matrices say, which are made when they are asked for [m, m].
    step : (float, float, float)
        Base after the motion as seen from base before it [m, m, rad].
    """

    __slots__ = ("_matrices", "in_plane", "step", "x")

    def __init__(self, x: Floats, jacobian: Floats, noise: Floats, step: tuple[float, float, float]) -> None:
        self.x, self.step = x, step
        self.in_plane: tuple[float, float, Sym3] | None = None
        self._matrices: tuple[Floats, Floats] | None = (jacobian, noise)

    @classmethod
    def of_pose(
        cls, x: Floats, in_plane: tuple[float, float, Sym3], step: tuple[float, float, float]
    ) -> PredictedMotion:
        """Return the motion of a state that is a pose alone."""
        motion = cls.__new__(cls)
        motion.x, motion.in_plane, motion.step, motion._matrices = x, in_plane, step, None
        return motion

    @property
    def jacobian(self) -> Floats:
        """How the state changes with the state before, (n, n)."""
        return self._made()[0]

    @property
    def noise(self) -> Floats:
        """Covariance of the motion, (n, n)."""
        return self._made()[1]

    def _made(self) -> tuple[Floats, Floats]:
        if self._matrices is None:
            assert self.in_plane is not None
            dx, dy, noise = self.in_plane
            self._matrices = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]]), to_matrix(noise)
        return self._matrices


class Ekf:
    """Predicts and updates (x, y, theta, ...), from and to values that the caller keeps.

    filterpy predicts a state that is more than a pose (a pose alone is six numbers of covariance, and plain floats take
    a third of the time); it does not update. It makes x of shape (n, 1), and a measurement of shape (m,) then silently
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
        if motion.in_plane is not None:
            return motion.x, _moved_in_plane(covariance, *motion.in_plane)
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


def _moved_in_plane(covariance: Floats, dx: float, dy: float, noise: Sym3) -> Floats:
    """Return ``F P F^T + Q`` of a pose that moves along the axes of the map."""
    xx, xy, xt, _, yy, yt, _, _, tt = covariance.ravel().tolist()
    return to_matrix(add(congruence((xx, xy, xt, yy, yt, tt), 1.0, 0.0, -dy, dx), noise))
