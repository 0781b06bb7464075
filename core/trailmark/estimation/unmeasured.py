"""Ways that nobody measures: what is unknown there is a speed, and its error lasts.

In a plain corridor a laser measures everything but the way along it. An error of the speed there is not new with every
motion: over motions in a row standard deviations add up, not variances, and the way is as uncertain as time goes on.
"""

from __future__ import annotations

import math

from trailmark.estimation.symmetric import Sym3
from trailmark.geometry import wrap_angle

__all__ = [
    "EVERYWHERE",
    "NOWHERE",
    "Sym2",
    "describe",
    "directions_above",
    "longest",
    "plus",
    "projected",
    "speed_variance",
    "squared_beyond",
    "squared_by_direction",
    "turned",
    "unmeasured_in",
]

#: The upper triangle of a symmetric 2x2 matrix over directions in the plane: (xx, xy, yy).
Sym2 = tuple[float, float, float]

NOWHERE: Sym2 = (0.0, 0.0, 0.0)
EVERYWHERE: Sym2 = (1.0, 0.0, 1.0)
# Share of a step's variance that is drift, from which on the step is not measured: drift says more than the motion.
_MOSTLY = 0.5

# Who drives on may do so in any direction: half of the square of the speed is that of each axis.
_SHARE_OF_AN_AXIS = 0.5


def unmeasured_in(covariance: Sym3, drift: Sym3) -> Sym2:
    """Return the directions of base in which a step is little better known than drift alone would, as a projection.

    Parameters
    ----------
    covariance : Sym3
        Of the step, drift included where it was not measured.
    drift : Sym3
        Of a step that nobody measured, the same forward and to the left.
    """
    variance_m2 = drift[0]
    return directions_above((covariance[0], covariance[1], covariance[3]), _MOSTLY * variance_m2)


def directions_above(a: Sym2, limit: float) -> Sym2:
    """Return the projection on the directions in which a matrix is larger than a limit."""
    xx, xy, yy = a
    mean, half = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    least = mean - half
    if least > limit:
        return EVERYWHERE
    if mean + half <= limit:
        return NOWHERE
    return (xx - least) / (2.0 * half), xy / (2.0 * half), (yy - least) / (2.0 * half)


def speed_variance(drift: Sym3, measured_mps: float) -> float:
    """Return the variance of a speed that nobody measures for long, along any axis [m^2/s^2].

    Parameters
    ----------
    drift : Sym3
        Of a step of 1 s that nobody measured, the same forward and to the left.
    measured_mps : float
        The last speed that was measured: who was that fast may go on, or stand [m/s].
    """
    return max(drift[0], _SHARE_OF_AN_AXIS * measured_mps * measured_mps)


def plus(a: Sym2, b: Sym2, factor: float) -> Sym2:
    """Return ``a + factor * b``."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


def projected(a: Sym2, onto: Sym2) -> Sym2:
    """Return ``onto a onto``."""
    xx, xy, yy = a
    p, q, r = onto
    left, both, right = p * xx + q * xy, p * xy + q * yy, q * xy + r * yy
    low = q * xx + r * xy
    return left * p + both * q, left * q + both * r, low * q + right * r


def squared_by_direction(sigmas_m: Sym2) -> Sym3:
    """Return the covariance of (x, y, theta) of standard deviations by direction."""
    xx, xy, yy = sigmas_m
    return xx * xx + xy * xy, xy * (xx + yy), 0.0, xy * xy + yy * yy, 0.0, 0.0


def squared_beyond(a: Sym2, limit: float) -> Sym2:
    """Return the square of what the eigenvalues have beyond a limit; those below it have nothing."""
    xx, xy, yy = a
    mean, half = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    most = max(mean + half - limit, 0.0) ** 2
    if half <= 1e-9 * mean:
        return most, 0.0, most
    least = max(mean - half - limit, 0.0) ** 2
    slope = 0.5 * (most - least) / half
    middle = 0.5 * (most + least)
    return middle + 0.5 * slope * (xx - yy), slope * xy, middle - 0.5 * slope * (xx - yy)


def turned(a: Sym2, angle_rad: float) -> Sym2:
    """Return the matrix in axes in which its directions are turned by an angle."""
    xx, xy, yy = a
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return (
        cos * cos * xx - 2.0 * cos * sin * xy + sin * sin * yy,
        cos * sin * (xx - yy) + (cos * cos - sin * sin) * xy,
        sin * sin * xx + 2.0 * cos * sin * xy + cos * cos * yy,
    )


def longest(a: Sym2) -> float:
    """Return the largest eigenvalue: of times by direction, the longest."""
    xx, xy, yy = a
    return 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)


def describe(unmeasured_s: Sym2, heading_rad: float, duration_s: float) -> str:
    """Return in words in which direction of base nothing measures the way, and since when.

    Parameters
    ----------
    unmeasured_s : Sym2
        For how long nobody has measured, by direction [s].
    heading_rad : float
        Of base, in the same axes [rad].
    duration_s : float
        How long it is told to be [s].
    """
    xx, xy, yy = unmeasured_s
    if math.hypot(xx - yy, 2.0 * xy) < _MOSTLY * (xx + yy):
        return f"nothing measures the way, for {duration_s:.1f} s"
    axis = 0.5 * wrap_angle(2.0 * (0.5 * math.atan2(2.0 * xy, xx - yy) - heading_rad))
    return f"nothing measures the way along {math.degrees(axis):.0f} deg of base, for {duration_s:.1f} s"
