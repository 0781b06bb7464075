"""What a matrix says of certainty: whether it can be an information or a covariance, and what was measured."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import ShapeError
from trailmark.estimation.symmetric import NOTHING, Sym3, diagonal, inverse, to_matrix
from trailmark.values import quick_dataclass

__all__ = ["Measured", "checked_covariance", "checked_information", "measured_directions", "says_something"]

# Relative to the diagonal: beyond rounding, and far below any correlation that means something.
_ASYMMETRIC = 1e-6
_NEGATIVE = 1e-9
_UNMEASURED = 1e-12
# In variance: 100 times as uncertain.
_SAYS_NOTHING = 1e4


@quick_dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """How an absolute estimate replaces what it measured.

    With ``x`` believed and ``z`` measured, ``x' = x + gain (z - x)`` and
    ``P' = (1 - gain) P (1 - gain)^T + covariance``.

    Attributes
    ----------
    rank : int
        How many directions were measured, 0 to 3.
    gain : (3, 3) float64 or None
        Projection on the measured directions; None when all three are, and everything is replaced.
    covariance : Sym3
        Of the measured directions; zero elsewhere.
    """

    rank: int
    gain: Floats | None
    covariance: Sym3


def checked_information(information: Floats) -> Sym3 | str:
    """Return the information as six floats, or why it cannot be one.

    Parameters
    ----------
    information : (3, 3) float64
        What a localizer gave: it has the shape, but may hold anything.
    """
    (xx, xy, xt), (yx, yy, yt), (tx, ty, tt) = information.tolist()
    total = xx + xy + xt + yx + yy + yt + tx + ty + tt
    if not math.isfinite(total):
        return "the information is not finite"
    if xx < 0.0 or yy < 0.0 or tt < 0.0:
        return f"the information has a negative diagonal: {xx:g}, {yy:g}, {tt:g}"
    if xy != yx or xt != tx or yt != ty:
        for a, b, scale in ((xy, yx, xx * yy), (xt, tx, xx * tt), (yt, ty, yy * tt)):
            if abs(a - b) > _ASYMMETRIC * max(abs(a), abs(b), _ASYMMETRIC * math.sqrt(scale)):
                return f"the information is not symmetric: {a:g} against {b:g}"
    checked = (xx, (xy + yx) / 2.0, (xt + tx) / 2.0, yy, (yt + ty) / 2.0, tt)
    is_plainly_fine = xy == xt == yt == 0.0 or inverse(checked) is not None
    return checked if is_plainly_fine or _is_positive(checked) else "the information is negative in a direction"


def checked_covariance(covariance: npt.ArrayLike) -> Floats | str:
    """Return a covariance of a whole pose, exactly symmetric, or why it cannot be one.

    Parameters
    ----------
    covariance : (3, 3) float64
        Of (x, y, theta).

    Raises
    ------
    ShapeError
        If it is not (3, 3).
    """
    if np.iscomplexobj(covariance):
        raise ShapeError("a covariance of (x, y, theta) is of real numbers, not of complex ones")
    matrix = np.asarray(covariance, dtype=np.float64)
    if matrix.shape != (3, 3):
        raise ShapeError(f"a covariance of (x, y, theta) must have shape (3, 3), not {matrix.shape}")
    if not np.isfinite(matrix).all():
        return "the covariance is not finite"
    sigmas = np.sqrt(np.abs(matrix.diagonal()))
    if (np.abs(matrix - matrix.T) > _ASYMMETRIC * np.outer(sigmas, sigmas)).any():
        return "the covariance is not symmetric"
    matrix = (matrix + matrix.T) / 2.0
    return matrix if np.linalg.eigvalsh(matrix)[0] > 0.0 else "the covariance is not positive definite"


def measured_directions(information: Sym3) -> Measured:
    """Return which directions an information matrix measures, and how well.

    A measured number that mixes axes, such as a visual shift of offset and heading, is split so that each axis
    contributes equally to it; the split does not depend on units.
    """
    covariance = inverse(information)
    if covariance is not None:
        return Measured(3, None, covariance)
    xx, xy, xt, yy, yt, tt = information
    if xy == xt == yt == 0.0:
        return _measured_axes(xx, yy, tt)
    # In units of each axis's own sigma the matrix has a unit diagonal, and rank is a plain question.
    sigmas = np.array([1.0 / math.sqrt(value) if value > NOTHING else 0.0 for value in _diagonal(information)])
    roots = np.divide(1.0, sigmas, out=np.zeros(3), where=sigmas > 0.0)
    values, vectors = np.linalg.eigh(_unit_diagonal(information))
    is_measured = values > _UNMEASURED
    directions, weights = vectors[:, is_measured], values[is_measured]
    gain = sigmas[:, None] * (directions @ directions.T) * roots
    spread = sigmas[:, None] * ((directions / weights) @ directions.T) * sigmas
    xx, xy, xt, _, yy, yt, _, _, tt = spread.ravel().tolist()
    return Measured(int(is_measured.sum()), gain, (xx, xy, xt, yy, yt, tt))


def _measured_axes(xx: float, yy: float, tt: float) -> Measured:
    """Return what independent axes measure, by the steps of the general way."""
    gains, variances, rank = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0
    for k, value in enumerate((xx, yy, tt)):
        if value > NOTHING:
            sigma = 1.0 / math.sqrt(value)
            gains[k], variances[k] = sigma * (1.0 / sigma), sigma * (1.0 / (sigma * value * sigma)) * sigma
            rank += 1
    return Measured(rank, to_matrix(diagonal(*gains)), diagonal(*variances))


def says_something(covariance: Sym3, drift: Sym3) -> bool:
    """Return whether a motion is known better than 100 times what drift would make of it, along every axis.

    One that is not measures nothing; taken at its word it would drown later digits.
    """
    return (
        covariance[0] < _SAYS_NOTHING * drift[0]
        and covariance[3] < _SAYS_NOTHING * drift[3]
        and covariance[5] < _SAYS_NOTHING * drift[5]
    )


def _diagonal(information: Sym3) -> tuple[float, float, float]:
    return information[0], information[3], information[5]


def _unit_diagonal(information: Sym3) -> Floats:
    """Return the matrix with a diagonal of ones, and zeros where nothing was measured."""
    roots = np.array([1.0 / math.sqrt(value) if value > NOTHING else 0.0 for value in _diagonal(information)])
    return np.asarray(roots[:, None] * to_matrix(information) * roots)


def _is_positive(information: Sym3) -> bool:
    """Return whether no direction has negative information, to rounding."""
    xx, xy, xt, yy, yt, tt = information
    # An axis without information has none in common with the others either.
    if any(a == 0.0 and (b or c) for a, b, c in ((xx, xy, xt), (yy, xy, yt), (tt, xt, yt))):
        return False
    return float(np.linalg.eigvalsh(_unit_diagonal(information))[0]) > -_NEGATIVE
