"""filterpy's extended Kalman filter, held to one shape and to angles that wrap."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from filterpy.kalman import ExtendedKalmanFilter

from trailmark.errors import ShapeError
from trailmark.geometry import wrap_angle

__all__ = ["PoseEkf"]

Array = npt.NDArray[np.float64]

_NOISE = tuple(np.eye(n) for n in range(4))
_ZERO = tuple(np.zeros(n) for n in range(4))


class PoseEkf(ExtendedKalmanFilter):  # type: ignore[misc]  # filterpy has no types
    """Predicts and updates (x, y, theta), from and to values that the caller keeps.

    filterpy makes x of shape (n, 1), and a measurement of shape (m,) then silently broadcasts it to (n, n): x is of
    shape (3,) here, always, and shapes are checked. It wraps no state and gates nothing: both are done around it.
    """

    def __init__(self) -> None:
        super().__init__(dim_x=3, dim_z=3)
        self.x = np.zeros(3)

    def predict_x(self, u: Array) -> None:
        """Take the moved state, which the motion model has computed."""
        self.x = u

    def moved(self, moved_x: Array, covariance: Array, jacobian: Array, noise: Array) -> Array:
        """Return the covariance after a motion: ``F P F^T + Q``."""
        self.P, self.F, self.Q = covariance, jacobian, noise
        self.predict(moved_x)
        moved_covariance: Array = self.P
        return moved_covariance

    def corrected(self, x: Array, covariance: Array, innovation: Array, jacobian: Array) -> tuple[Array, Array]:
        """Return state and covariance after a measurement of unit noise.

        Parameters
        ----------
        x, covariance : (3,), (3, 3) float64
            The prior.
        innovation : (k,) float64
            Measured less predicted, angles wrapped, in standard deviations of the measurement.
        jacobian : (k, 3) float64
            How the prediction changes with the state.

        Raises
        ------
        ShapeError
            If the shapes do not fit: numpy would broadcast them.
        """
        k = len(innovation)
        if x.shape != (3,) or innovation.shape != (k,) or jacobian.shape != (k, 3):
            raise ShapeError(f"state {x.shape}, innovation {innovation.shape} and jacobian {jacobian.shape} do not fit")
        self.x, self.P = x, covariance
        self.update(innovation, lambda _: jacobian, lambda _: _ZERO[k], R=_NOISE[k])
        updated: Array = self.x
        updated[2] = wrap_angle(float(updated[2]))
        return updated, self.P
