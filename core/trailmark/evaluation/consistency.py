"""Does a covariance say the truth? NEES against ground truth, NIS against the belief.

Both are squared errors in units of the stated covariance. When it is right they follow a chi-square
distribution whose degrees of freedom are the numbers that were measured, so their sum over many
estimates is told apart from chance by its quantiles (Bar-Shalom et al. 2001, Sec. 5.4).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import DataError, ShapeError
from trailmark.evaluation.naming import metric_name
from trailmark.geometry import wrap_angles

__all__ = ["Consistency", "chi2_quantile", "consistency_of", "information_rank", "nees"]


# An eigenvalue below this share of the largest (units scaled away) is a direction that was not measured.
_RANK_TOLERANCE = 1e-9
# Squares per degree of freedom between these are near enough to 1: a sigma that is off by less than 2.2 times weighs an
# estimate about as well, however many of them there are to tell it.
_LEAST_PER_DOF, _MOST_PER_DOF = 0.2, 5.0


@dataclass(frozen=True, slots=True)
class Consistency:
    """A sum of squared normalised errors beside its chi-square interval, all per degree of freedom.

    Attributes
    ----------
    n : int
        Number of estimates.
    dof : int
        Sum of their degrees of freedom.
    per_dof : float
        Sum of the squares divided by `dof`; 1 is expected.
    lower, upper : float
        The interval in which `per_dof` falls with probability `confidence` when the covariance is right.
    inside : float
        Share of estimates below their own quantile of `confidence`; `confidence` is expected.
    confidence : float
        The probability.
    """

    n: int
    dof: int
    per_dof: float
    lower: float
    upper: float
    inside: float
    confidence: float

    @property
    def verdict(self) -> Literal["consistent", "overconfident", "underconfident"]:
        """``overconfident``: the errors are larger than the covariances say, by more than chance and than matters."""
        if self.per_dof > max(self.upper, _MOST_PER_DOF):
            return "overconfident"
        return "underconfident" if self.per_dof < min(self.lower, _LEAST_PER_DOF) else "consistent"

    def metrics(self, word: str) -> dict[str, float]:
        """Return the metrics by name; `word` is ``nees`` or ``nis``."""
        protocol = (f"n={self.n}", f"dof={self.dof}")
        return {
            metric_name(f"{word}_per_dof", *protocol): self.per_dof,
            metric_name(f"{word}_inside_fraction", f"p={self.confidence:g}", f"n={self.n}"): self.inside,
        }

    def document(self) -> dict[str, object]:
        """Return all numbers and the verdict, for a report."""
        fields = ("n", "dof", "per_dof", "lower", "upper", "inside", "confidence", "verdict")
        return {name: getattr(self, name) for name in fields}


def chi2_quantile(probability: float, dof: npt.ArrayLike) -> Floats:
    """Return the quantile of the chi-square distribution, of the shape of `dof`.

    Parameters
    ----------
    probability : float
        Share of the distribution below the quantile, from 0 to 1.
    dof : array_like
        Degrees of freedom.

    Returns
    -------
    float64 array
        Quantiles.
    """
    from scipy.special import gammaincinv  # here: importing the metrics stays cheap

    return np.asarray(2.0 * gammaincinv(np.asarray(dof, dtype=np.float64) / 2.0, probability))


def consistency_of(squares: Floats, dof: Floats, confidence: float = 0.95) -> Consistency:
    """Return how well squared normalised errors fit their degrees of freedom.

    Parameters
    ----------
    squares : (N,) float64
        NEES or NIS of each estimate.
    dof : (N,) float64
        Degrees of freedom of each; they may differ.
    confidence : float
        Probability of the intervals.

    Raises
    ------
    DataError
        If there is no estimate with a degree of freedom.
    """
    known = np.isfinite(squares) & np.isfinite(dof) & (dof > 0)
    squares, dof = squares[known], dof[known]
    if len(squares) == 0:
        raise DataError("consistency needs at least one estimate with a squared error and degrees of freedom")
    total = float(dof.sum())
    tail = (1.0 - confidence) / 2.0
    lower, upper = (float(chi2_quantile(p, total)) / total for p in (tail, 1.0 - tail))
    inside = float((squares <= chi2_quantile(confidence, dof)).mean())
    return Consistency(len(squares), int(total), float(squares.sum()) / total, lower, upper, inside, confidence)


def nees(errors: Floats, information: Floats) -> tuple[Floats, Floats]:
    """Return the normalised estimation error squared of each estimate, and its degrees of freedom.

    ``e^T I e`` with the stated information I (inverse covariance); the degrees of freedom are the rank of I.

    Parameters
    ----------
    errors : (N, 3) float64
        x, y, theta of each error, theta is wrapped here [m, m, rad].
    information : (N, 3, 3) float64
        Information in the axes of the errors.

    Raises
    ------
    ShapeError
        If the shapes do not fit.
    """
    if errors.ndim != 2 or errors.shape[1] != 3 or information.shape != (len(errors), 3, 3):
        raise ShapeError(f"errors {errors.shape} and information {information.shape} must be (N, 3) and (N, 3, 3)")
    wrapped = np.column_stack([errors[:, :2], wrap_angles(errors[:, 2])])
    return np.einsum("ni,nij,nj->n", wrapped, information, wrapped), information_rank(information)


def information_rank(information: Floats) -> Floats:
    """Return the rank of each (3, 3) information matrix, whatever the units of its rows, (N,)."""
    diagonal = np.sqrt(np.maximum(np.diagonal(information, axis1=1, axis2=2), 0.0))
    scale = 1.0 / np.where(diagonal > 0.0, diagonal, 1.0)
    scaled = information * scale[:, :, None] * scale[:, None, :]
    values = np.linalg.eigvalsh(np.nan_to_num(scaled))
    return np.asarray((values > _RANK_TOLERANCE * np.maximum(values[:, -1:], 1e-300)).sum(axis=1), dtype=np.float64)
