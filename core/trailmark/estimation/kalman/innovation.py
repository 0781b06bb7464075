"""What a measurement says against a belief: computed once, for the gate and for the update."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import ShapeError
from trailmark.estimation.symmetric import Sym3, inverse, to_matrix

__all__ = ["Innovation", "LinearModel", "MeasurementModel", "least_squares", "nis_of"]

_RANK = 1e-9


class MeasurementModel(Protocol):
    """A measurement of unit noise, of any state."""

    def innovation(self, x: Floats) -> tuple[Floats, Floats]:
        """Return measured less predicted, (k,), angles wrapped, and the Jacobian of the prediction, (k, 3)."""


class LinearModel:
    """A measurement that is linear in the state: ``y(x) = y0 - H (x - x0)``.

    Parameters
    ----------
    innovation : (k,) float64
        Measured less predicted at `x`, in standard deviations of the measurement.
    jacobian : (k, n) float64
        How the prediction changes with the state, anywhere.
    x : (n,) float64
        A state.
    """

    __slots__ = ("_innovation", "_jacobian", "_x")

    def __init__(self, innovation: Floats, jacobian: Floats, x: Floats) -> None:
        self._innovation, self._jacobian, self._x = innovation, jacobian, x

    def innovation(self, x: Floats) -> tuple[Floats, Floats]:
        """Return what is left of the innovation at a state, and the Jacobian."""
        return self._innovation - self._jacobian @ (x - self._x), self._jacobian


class Innovation:
    """An innovation with what was computed of it.

    Parameters
    ----------
    innovation : (k,) float64
        Measured less predicted, angles wrapped, in standard deviations of the measurement; k is at most 3.
    jacobian : (k, n) float64
        How the prediction changes with the state.
    covariance : (n, n) float64
        Of the state.

    Attributes
    ----------
    cross : (n, k) float64
        ``P H^T``.
    inverse : (k, k) float64
        ``S^-1`` with ``S = H P H^T + 1``.
    nis : float
        ``y^T S^-1 y``, before any update (filterpy knows it only after).
    scale : float or (k,) float64
        Root of the weight that it was left, of all rows or of each.
    spread : (k,) float64
        Variance of what is predicted, row by row: the diagonal of ``H P H^T``.

    Raises
    ------
    ShapeError
        If the shapes do not fit: numpy would broadcast them.
    """

    __slots__ = ("_gain", "_pose_gain", "_size", "cross", "innovation", "inverse", "jacobian", "nis", "scale", "spread")

    def __init__(self, innovation: Floats, jacobian: Floats, covariance: Floats, scale: float | Floats = 1.0) -> None:
        if jacobian.shape != (len(innovation), len(covariance)) or innovation.ndim != 1:
            raise ShapeError(
                f"innovation {innovation.shape}, jacobian {jacobian.shape} and covariance {covariance.shape} do not fit"
            )
        self.innovation, self.jacobian, self.scale = innovation, jacobian, scale
        self.cross = covariance.dot(jacobian.T)  # the same as `@`, in two thirds of the time
        predicted = jacobian.dot(self.cross)
        self.inverse = _inverse(predicted)
        self.spread = predicted.diagonal()
        self.nis = float(innovation.dot(self.inverse).dot(innovation))
        self._size: tuple[float, float, Floats] | None = None
        self._gain: Floats | None = None
        self._pose_gain: Floats | None = None

    def size_in_pose(self) -> tuple[float, float, Floats]:
        """Return way and turn of ``H^-1 y`` [m, rad], and the gain in the pose ``K H``, (3, 3).

        Every belief asks this of the innovations of a window of time: it is computed at the first question.
        """
        if self._size is None:
            jacobian = self.jacobian[:, :3]
            x, y, turn = least_squares(jacobian, self.innovation)
            self._size = math.hypot(x, y), abs(turn), self.pose_gain()
        return self._size

    def gain(self) -> Floats:
        """Return the gain ``K``, (n, k)."""
        if self._gain is None:
            self._gain = self.cross.dot(self.inverse)
        return self._gain

    def pose_gain(self) -> Floats:
        """Return the gain in the pose ``K H``, (3, 3)."""
        if self._pose_gain is None:
            self._pose_gain = self.gain()[:3].dot(self.jacobian[:, :3])
        return self._pose_gain

    def weighted(self, weight: float | Floats, covariance: Floats) -> Innovation:
        """Return the same with its information scaled, by one weight or one of each row."""
        root = weight**0.5
        rows = root if isinstance(root, float) else root[:, np.newaxis]
        return Innovation(root * self.innovation, rows * self.jacobian, covariance, root)


def nis_of(innovation: Floats, jacobian: Floats, covariance: Floats) -> float:
    """Return ``y^T S^-1 y`` with ``S = H P H^T + 1``."""
    return float(innovation.dot(_inverse(jacobian.dot(covariance).dot(jacobian.T))).dot(innovation))


def least_squares(matrix: Floats, values: Floats) -> tuple[float, float, float]:
    """Return the shortest ``(x, y, z)`` of those that are nearest to ``matrix (x, y, z) = values``."""
    x, y, z = np.linalg.lstsq(matrix, values, rcond=_RANK)[0].tolist()
    return x, y, z


def _inverse(spread: Floats) -> Floats:
    """Return ``(H P H^T + 1)^-1``; up to three rows in plain floats."""
    size = len(spread)
    if size == 1:
        return np.array([[1.0 / (spread.item() + 1.0)]])
    if size == 2:
        xx, xy, _, yy = spread.ravel().tolist()
        xx, yy = xx + 1.0, yy + 1.0
        det = xx * yy - xy * xy
        if det > 1e-12 * xx * yy:
            return np.array([[yy / det, -xy / det], [-xy / det, xx / det]])
    elif size == 3:
        xx, xy, xt, _, yy, yt, _, _, tt = spread.ravel().tolist()
        s: Sym3 = (xx + 1.0, xy, xt, yy + 1.0, yt, tt + 1.0)
        inverted = inverse(s)
        if inverted is not None:
            return to_matrix(inverted)
    # More rows, or one direction is 1e12 times less certain than another.
    return np.asarray(np.linalg.inv(spread + np.eye(size)))
