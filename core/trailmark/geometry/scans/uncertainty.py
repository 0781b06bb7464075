"""How far a match, and the step between two matches, can be off."""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Pose2
from trailmark.geometry.walls import measured_information

__all__ = ["errors_in_common", "match_information", "step_information"]

#: Rays that are farther apart than this are taken to err independently of each other.
_LAGS = 12
#: What walls did not tell of the first pose was expected from odometry, and that is taken to be wrong by this much [m]:
#: if it were unknown, half a degree between the free directions of both poses would leave a corridor no width.
_EXPECTED_M = 0.3


def errors_in_common(residuals: Floats) -> float:
    """Return how many neighbouring rays share one error: as many count as one.

    The sum of the autocorrelation of the residuals along the scan, with Bartlett's window (Newey & West 1987). White
    noise gives 1; a wall that is bent, or a scan of the map that lies askew, gives as many as the rays that see it.

    Parameters
    ----------
    residuals : (N,) float64
        Distances of the ends of rays beyond their walls, in the order of the rays; NaN where there is none [m].

    Returns
    -------
    float
        At least 1.
    """
    known = np.nan_to_num(residuals)
    power = float(known @ known)
    if power <= 0.0:
        return 1.0
    lags = range(1, min(_LAGS, len(known) - 1) + 1)
    shared = sum((1.0 - lag / (_LAGS + 1.0)) * float(known[:-lag] @ known[lag:]) for lag in lags)
    return max(1.0, 1.0 + 2.0 * shared / power)


def match_information(hessian: Floats, residuals: Floats, sigma_m: float) -> Floats:
    """Return what a match of ray ends to walls tells of (x, y, theta); nothing along a plain corridor.

    Parameters
    ----------
    hessian : (3, 3) float64
        Gauss-Newton's matrix of the match.
    residuals : (N,) float64
        See `errors_in_common`.
    sigma_m : float
        Standard deviation of the distance of an end to its wall; that of the residuals where it is larger [m].
    """
    n_lines = int(np.isfinite(residuals).sum())
    residual_m = math.sqrt(float(np.nansum(np.square(residuals))) / max(n_lines, 1))
    variance = max(sigma_m, residual_m) ** 2 * errors_in_common(residuals)
    return measured_information(hessian, n_lines) / variance


def step_information(before: Pose2, information_before: Floats, now: Pose2, information_now: Floats) -> Floats:
    """Return what two poses on one local map tell of the step between them, in the axes of base at the first.

    Both are uncertain, and independently so: their rays are others. A direction that the second does not tell is not
    told; one that only the first does not tell is worth little.

    Parameters
    ----------
    before, now : Pose2
        Of base on the local map.
    information_before, information_now : (3, 3) float64
        Of (x, y, theta) of these, in its axes.

    Returns
    -------
    (3, 3) float64
        Of (x, y, theta) of ``before.between(now)``.
    """
    way_x, way_y = now.x - before.x, now.y - before.y
    # an error of the heading before moves the place now, as seen from before
    carried_back = np.array([[1.0, 0.0, way_y], [0.0, 1.0, -way_x], [0.0, 0.0, 1.0]])
    expected = np.diag([_EXPECTED_M**-2, _EXPECTED_M**-2, 0.0])
    covariance = np.linalg.pinv(carried_back.T @ (information_before + expected) @ carried_back, hermitian=True)
    both = information_now @ np.linalg.inv(np.eye(3) + covariance @ information_now)
    cos, sin = math.cos(before.theta), math.sin(before.theta)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    told = turn @ both @ turn.T
    return np.asarray((told + told.T) / 2.0)
