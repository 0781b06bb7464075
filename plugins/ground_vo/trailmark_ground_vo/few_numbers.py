"""Kernels on a few numbers: a median, and the inverse of a symmetric (3, 3) matrix.

numba has numpy's own for both. With them an audit took eight seconds to compile, as what they say of wrong shapes is
compiled too.
"""

from __future__ import annotations

from typing import Any

from trailmark.arrays import Floats
from trailmark.kernels import kernel

__all__ = ["median_of", "solve_symmetric"]


@kernel
def median_of(values: Floats) -> float:
    """Return the median of a few numbers (N,), at least one, as numpy does."""
    ordered = values.copy()
    for last in range(1, ordered.shape[0]):
        value, at = ordered[last], last
        while at > 0 and ordered[at - 1] > value:
            ordered[at] = ordered[at - 1]
            at -= 1
        ordered[at] = value
    middle = ordered.shape[0] // 2
    return float(ordered[middle] if ordered.shape[0] % 2 else (ordered[middle - 1] + ordered[middle]) / 2.0)


@kernel
def solve_symmetric(
    rows: tuple[float, float, float, float, float, float], right: tuple[float, float, float]
) -> tuple[Any, Any]:
    """Solve A x = b for a symmetric (3, 3) matrix that has an inverse.

    Parameters
    ----------
    rows : 6 floats
        A_00, A_01, A_02, A_11, A_12, A_22.
    right : 3 floats
        b.

    Returns
    -------
    x : 3 floats
    diagonal : 3 floats
        Of the inverse of A.
    """
    a, b, c, d, e, f = rows
    c_00, c_01, c_02 = d * f - e * e, c * e - b * f, b * e - c * d
    c_11, c_12, c_22 = a * f - c * c, b * c - a * e, a * d - b * b
    scale = 1.0 / (a * c_00 + b * c_01 + c * c_02)
    x = (c_00 * right[0] + c_01 * right[1] + c_02 * right[2]) * scale
    y = (c_01 * right[0] + c_11 * right[1] + c_12 * right[2]) * scale
    z = (c_02 * right[0] + c_12 * right[1] + c_22 * right[2]) * scale
    return (x, y, z), (c_00 * scale, c_11 * scale, c_22 * scale)
