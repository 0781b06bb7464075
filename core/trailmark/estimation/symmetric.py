"""Symmetric 3x3 matrices as six floats.

A covariance of (x, y, theta) is handled at every frame. As plain floats a step costs about 1 us; the same
step with (3, 3) arrays costs 10 us, nearly all of it numpy's overhead per call.
"""

from __future__ import annotations

import struct

import numpy as np

from trailmark.arrays import Floats

__all__ = [
    "NOTHING",
    "ZERO",
    "Sym3",
    "add",
    "congruence",
    "diagonal",
    "frozen_matrix",
    "inverse",
    "scaled",
    "sheared",
    "subtract",
    "to_matrix",
    "turned",
]

#: (xx, xy, xt, yy, yt, tt)
Sym3 = tuple[float, float, float, float, float, float]

ZERO: Sym3 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

#: Information below this says nothing: its inverse would leave the range of floats when squared.
NOTHING = 1e-100

# A pivot that is this small a part of its diagonal element is rounding: the matrix is singular.
_SINGULAR = 1e-12

_pack = struct.Struct("9d").pack


def diagonal(xx: float, yy: float, tt: float) -> Sym3:
    """Return a diagonal matrix."""
    return xx, 0.0, 0.0, yy, 0.0, tt


def to_matrix(a: Sym3) -> Floats:
    """Return the matrix as a (3, 3) array."""
    xx, xy, xt, yy, yt, tt = a
    return np.array((xx, xy, xt, xy, yy, yt, xt, yt, tt)).reshape(3, 3)  # nested lists take half as long again


def frozen_matrix(a: Sym3) -> Floats:
    """Return the matrix as a (3, 3) array over bytes, which nobody can write to: it is shared without a copy."""
    xx, xy, xt, yy, yt, tt = a
    return np.ndarray((3, 3), np.float64, _pack(xx, xy, xt, xy, yy, yt, xt, yt, tt))


def add(a: Sym3, b: Sym3) -> Sym3:
    """Return ``a + b``."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]


def subtract(a: Sym3, b: Sym3) -> Sym3:
    """Return ``a - b``."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3], a[4] - b[4], a[5] - b[5]


def scaled(a: Sym3, factor: float) -> Sym3:
    """Return ``factor * a``."""
    return factor * a[0], factor * a[1], factor * a[2], factor * a[3], factor * a[4], factor * a[5]


def congruence(a: Sym3, cos: float, sin: float, u: float, v: float) -> Sym3:
    """Return ``A a A^T`` for ``A = [[cos, -sin, u], [sin, cos, v], [0, 0, 1]]``: turned, then moved to a lever.

    Parameters
    ----------
    a : Sym3
        Upper triangle of a symmetric matrix.
    cos, sin : float
        Of the angle of the turn.
    u, v : float
        Last column of ``A``.

    Returns
    -------
    Sym3
        Upper triangle of the product.
    """
    xx, xy, xt, yy, yt, tt = a
    cross_x, cross_y = cos * xt - sin * yt, sin * xt + cos * yt
    turned_xx = cos * cos * xx - 2.0 * cos * sin * xy + sin * sin * yy
    turned_xy = cos * sin * (xx - yy) + (cos * cos - sin * sin) * xy
    turned_yy = sin * sin * xx + 2.0 * cos * sin * xy + cos * cos * yy
    return (
        turned_xx + 2.0 * u * cross_x + u * u * tt,
        turned_xy + u * cross_y + v * cross_x + u * v * tt,
        cross_x + u * tt,
        turned_yy + 2.0 * v * cross_y + v * v * tt,
        cross_y + v * tt,
        tt,
    )


def turned(a: Sym3, cos: float, sin: float) -> Sym3:
    """Return ``A a A^T`` for ``A = [[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]``, as `congruence` without a lever."""
    xx, xy, xt, yy, yt, tt = a
    cos2, sin2, both = cos * cos, sin * sin, 2.0 * cos * sin * xy
    return (
        cos2 * xx - both + sin2 * yy,
        cos * sin * (xx - yy) + (cos2 - sin2) * xy,
        cos * xt - sin * yt,
        sin2 * xx + both + cos2 * yy,
        sin * xt + cos * yt,
        tt,
    )


def sheared(a: Sym3, rate: float) -> Sym3:
    """Return ``A a A^T`` for ``A = [[1, 0, 0], [0, 1, 0], [rate, 0, 1]]``: the third number grows with the first."""
    xx, xy, xt, yy, yt, tt = a
    return xx, xy, xt + rate * xx, yy, yt + rate * xy, tt + 2.0 * rate * xt + rate * rate * xx


def inverse(a: Sym3) -> Sym3 | None:
    """Return the inverse of a positive definite matrix, itself positive definite; None if there is none."""
    xx, xy, xt, yy, yt, tt = a
    if not (xx > NOTHING and yy > NOTHING and tt > NOTHING):
        return None
    l21, l31 = xy / xx, xt / xx  # a = L D L^T
    d2 = yy - l21 * xy
    if not d2 > _SINGULAR * yy:
        return None
    rest = yt - l31 * xy
    l32 = rest / d2
    d3 = tt - l31 * xt - l32 * rest
    if not d3 > _SINGULAR * tt:
        return None
    i1, i2, i3 = 1.0 / xx, 1.0 / d2, 1.0 / d3
    m31 = l21 * l32 - l31  # the rows of L^-1 are (1, 0, 0), (-l21, 1, 0), (m31, -l32, 1)
    return (
        i1 + l21 * l21 * i2 + m31 * m31 * i3,
        -l21 * i2 - m31 * l32 * i3,
        m31 * i3,
        i2 + l32 * l32 * i3,
        -l32 * i3,
        i3,
    )
