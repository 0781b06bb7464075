"""A chain of planar poses by Gauss-Newton: the normal equations are banded, three blocks wide.

Each pose is tied to the next by a motion, and any pose by what measured it. The Cholesky factor of the band gives the
covariance of the newest pose without more work, and that of any other by three columns of the inverse.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from trailmark.arrays import Floats
from trailmark.geometry import wrap_angles
from trailmark.values import quick_dataclass

__all__ = ["BandedFactor", "ChainBlocks", "ChainMotions", "chain_blocks", "motion_chi_squares"]

_BAND = 5
# A pivot that is this small a part of its diagonal element is known to a per cent or two: the rest is rounding.
_SINGULAR = 1e-12


@quick_dataclass(frozen=True, slots=True, eq=False)
class ChainMotions:
    """The motions from each pose of a chain to the next.

    Attributes
    ----------
    measured : (N - 1, 3) float64
        The next pose as seen from this one, x, y and theta [m, m, rad].
    information : (N - 1, 3, 3) float64
        Of these numbers.
    """

    measured: Floats
    information: Floats


@quick_dataclass(frozen=True, slots=True, eq=False)
class ChainBlocks:
    """Normal equations of a chain at some poses.

    Attributes
    ----------
    diagonal : (N, 3, 3) float64
        Second derivatives by each pose.
    upper : (N - 1, 3, 3) float64
        Second derivatives by each pose and the next.
    gradient : (N, 3) float64
        First derivatives of half the squares.
    """

    diagonal: Floats
    upper: Floats
    gradient: Floats


class BandedFactor:
    """The Cholesky factor of the normal equations of a chain.

    Parameters
    ----------
    blocks : ChainBlocks
        The equations.
    damping : float
        By which share the diagonal is raised (Levenberg).

    Raises
    ------
    numpy.linalg.LinAlgError
        If a direction is not determined, or so little beside another that rounding hides it.
    """

    def __init__(self, blocks: ChainBlocks, damping: float = 0.0) -> None:
        n = len(blocks.diagonal)
        band = np.zeros((_BAND + 1, 3 * n))
        for row in range(3):
            for column in range(row, 3):
                band[_BAND + row - column, column::3] = blocks.diagonal[:, row, column]
            for column in range(3):
                band[_BAND - 3 + row - column, 3 + column :: 3] = blocks.upper[:, row, column]
        band[_BAND] *= 1.0 + damping
        self._n = n
        least = _SINGULAR * band[_BAND]
        self._factor = cholesky_banded(band, overwrite_ab=True, check_finite=False)
        if not (self._factor[_BAND] ** 2 >= least).all():
            raise np.linalg.LinAlgError("a direction is known next to nothing of, beside another")

    def step(self, gradient: Floats) -> Floats:
        """Return the change of the poses that leads down, (N, 3)."""
        solved = cho_solve_banded((self._factor, False), -gradient.ravel(), check_finite=False)
        return np.asarray(solved.reshape(-1, 3))

    def covariance(self, index: int) -> Floats:
        """Return the covariance of one pose, (3, 3)."""
        if index == self._n - 1:
            last = self._factor[:, -3:]
            corner = np.array(
                [
                    [last[_BAND, 0], last[_BAND - 1, 1], last[_BAND - 2, 2]],
                    [0.0, last[_BAND, 1], last[_BAND - 1, 2]],
                    [0.0, 0.0, last[_BAND, 2]],
                ]
            )
            root = np.linalg.inv(corner)
            return np.asarray(root @ root.T)
        unit = np.zeros((3 * self._n, 3))
        unit[3 * index : 3 * index + 3] = np.eye(3)
        columns = cho_solve_banded((self._factor, False), unit, check_finite=False)
        block = columns[3 * index : 3 * index + 3]
        return np.asarray((block + block.T) / 2.0)


def chain_blocks(poses: Floats, motions: ChainMotions) -> ChainBlocks:
    """Return the normal equations of the motions alone, at some poses (N, 3)."""
    n = len(poses)
    diagonal, gradient = np.zeros((n, 3, 3)), np.zeros((n, 3))
    if n == 1:
        return ChainBlocks(diagonal, np.zeros((0, 3, 3)), gradient)
    errors, between, cos, sin = _errors(poses, motions)
    at_second = np.zeros((n - 1, 3, 3))
    at_second[:, 0, 0] = at_second[:, 1, 1] = cos
    at_second[:, 0, 1], at_second[:, 1, 0] = sin, -sin
    at_second[:, 2, 2] = 1.0
    at_first = -at_second
    at_first[:, 0, 2], at_first[:, 1, 2] = between[:, 1], -between[:, 0]
    weighted_first = np.swapaxes(at_first, 1, 2) @ motions.information
    weighted_second = np.swapaxes(at_second, 1, 2) @ motions.information
    diagonal[:-1] += weighted_first @ at_first
    diagonal[1:] += weighted_second @ at_second
    gradient[:-1] += (weighted_first @ errors[:, :, np.newaxis])[:, :, 0]
    gradient[1:] += (weighted_second @ errors[:, :, np.newaxis])[:, :, 0]
    return ChainBlocks(diagonal, weighted_first @ at_second, gradient)


def motion_chi_squares(poses: Floats, motions: ChainMotions) -> Floats:
    """Return how far each motion is off at some poses, in the measure of its information, (N - 1,)."""
    if len(poses) == 1:
        return np.zeros(0)
    errors = _errors(poses, motions)[0]
    return np.asarray(np.einsum("ni,nij,nj->n", errors, motions.information, errors))


def _errors(poses: Floats, motions: ChainMotions) -> tuple[Floats, Floats, Floats, Floats]:
    """Return errors and what lies between the poses, (N - 1, 3), and cosine and sine of the first headings."""
    change = poses[1:] - poses[:-1]
    cos, sin = np.cos(poses[:-1, 2]), np.sin(poses[:-1, 2])
    between = np.column_stack(
        [cos * change[:, 0] + sin * change[:, 1], cos * change[:, 1] - sin * change[:, 0], change[:, 2]]
    )
    errors = between - motions.measured
    errors[:, 2] = wrap_angles(errors[:, 2])
    return errors, between, cos, sin
