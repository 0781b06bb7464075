"""How the error of a driven step grows: random walks along the way and over time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats

__all__ = ["Spread", "random_walk", "step_covariance"]


@dataclass(frozen=True, slots=True)
class Spread:
    """Variances of a step's random walks.

    Attributes
    ----------
    along_m2 : float
        Of the distance driven [m^2].
    across_m2 : float
        Of sliding sideways [m^2].
    turn_rad2 : float
        Of the heading [rad^2].
    """

    along_m2: float
    across_m2: float
    turn_rad2: float


def step_covariance(forward_m: float, left_m: float, spread: Spread) -> Floats:
    """Return the covariance of a step's (x, y, theta), seen from where it began.

    The heading is a random walk along the step, so a step that ends at ``(x, y)`` misses to its side by what the
    heading missed on the way: with ``q`` the variance of the turn, the lateral error ``e = int n d`` has the variance
    ``q L^2 / 3`` and the covariance ``q L / 2`` with the heading (``L`` the chord, ``n`` its normal). In this way a
    straight line cut into any number of steps has the same covariance at its end; on an arc that holds to the first
    order of its turn.

    Parameters
    ----------
    forward_m, left_m : float
        The step [m].
    spread : Spread
        Variances of its random walks.

    Returns
    -------
    (3, 3) float64
        Positive definite where the variances are positive.
    """
    q = spread.turn_rad2
    x, y = forward_m, left_m
    xx = spread.along_m2 + q * y * y / 3.0  # d(x, y)/d(theta) = (-y, x)
    yy = spread.across_m2 + q * x * x / 3.0
    xy, xt, yt = -q * x * y / 3.0, -q * y / 2.0, q * x / 2.0
    return np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, q]])


def random_walk(*parts: tuple[float, float]) -> float:
    """Return the variance of random walks: pairs of (sigma per root of a unit, way or time in that unit)."""
    return math.fsum(sigma * sigma * abs(amount) for sigma, amount in parts)
