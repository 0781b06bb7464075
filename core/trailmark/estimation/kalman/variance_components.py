"""Variance components: how much of what was seen each localizer has to answer for, by whom it was compared with."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.gate import threshold

__all__ = [
    "AT_ITS_WORD",
    "AT_ITS_WORD_AGAIN",
    "CLIPPED",
    "CLIPPED_MEANS",
    "FALLS",
    "GROWS",
    "MOST",
    "Key",
    "Pairing",
    "Shares",
    "both_sides",
]

#: The largest scale. None is below one: a source that has erred by less than it says may have its errors before it.
MOST = 2e4
#: A localizer is taken at its word up to this; once it is not, until it is much nearer.
AT_ITS_WORD, AT_ITS_WORD_AGAIN = 1.4, 1.15
#: By which factor a scale that is used grows or falls at most [1/s].
GROWS, FALLS = 1.25, 0.97
#: Beyond this quantile a difference counts as if it were at it.
CLIPPED = 0.8
#: Mean of a chi-square variable that is clipped there, over its degrees of freedom, by these.
CLIPPED_MEANS = {1: 0.6786545589528749, 2: 0.7999999999999998, 3: 0.8482812708372021}
#: A determinant below this, of a matrix with a unit diagonal, is left to elimination with pivots.
_SINGULAR = 1e-6

#: Localizer, and whether it is about its motion or its absolute estimates.
Key = tuple[str, bool]
#: What was compared how.
Pairing = tuple[str, tuple[Key, ...]]


class Shares:
    """Both sides of the likelihood equations of each localizer, by what it was compared with."""

    def __init__(self) -> None:
        self._seen: dict[Key, dict[tuple[str, str], tuple[float, float, float]]] = {}

    def localizers(self) -> list[Key]:
        """Return the localizers."""
        return sorted(self._seen)

    def add(self, key: Key, kind: str, keys: tuple[Key, ...], sides: tuple[float, float], information: float) -> None:
        """Add what was seen of a localizer's own share of differences, what is expected, and how much that tells."""
        if kind == "motion" or (kind == "other" and not key[1]):
            others = next(name for name, of_motion in keys if of_motion == key[1] and name != key[0])
        else:
            others = f"{keys[0][0]} fix" if key[1] else keys[-1][0]
        of_key = self._seen.setdefault(key, {})
        seen, expected, told = of_key.get((kind, others), (0.0, 0.0, 0.0))
        of_key[kind, others] = seen + sides[0], expected + sides[1], told + information

    def evidence(self, key: Key) -> tuple[float, float]:
        """Return how many numbers say something of a localizer, and what they tell; of several of one time the most."""
        _, expected, told = zip(*self._seen[key].values())
        return max(expected), max(told)

    def ratio_of(self, key: Key) -> float:
        """Return seen over expected, of all that was compared."""
        seen, expected, _ = (sum(side) for side in zip(*self._seen[key].values()))
        return max(seen / expected, 1e-3) if expected > 0.0 else 1.0


def both_sides(values: Floats, covariances: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the two sides of the likelihood equation of each share, and how much they tell of its factor, (m,) each.

    The last is twice the Fisher information of the log of a share's factor, the others known: where a share is small
    beside the rest, an error of the rest is easily taken for one of it, and many differences tell little.

    Parameters
    ----------
    values : (N, d) float64
        Differences.
    covariances : (N, m, d, d) float64
        The shares in their covariance, as now believed.
    """
    size = values.shape[1]
    total = covariances.sum(axis=1)
    roots = np.sqrt(np.diagonal(total, axis1=1, axis2=2))
    scales = 1.0 / (roots[:, :, None] * roots[:, None, :])
    weight = _inverse_of_each(total * scales) * scales
    solved = (weight @ values[:, :, None])[:, :, 0]
    squares = (solved * values).sum(axis=1)
    limit = threshold(CLIPPED, size)
    clipped = np.minimum(1.0, limit / np.maximum(squares, 1e-300)) / CLIPPED_MEANS[size]
    outer = (clipped[:, None] * solved)[:, :, None] * solved[:, None, :]
    flat = covariances.transpose(1, 0, 2, 3).reshape(covariances.shape[1], -1)
    information = np.einsum("nmij,nmji->m", (of_share := weight[:, None] @ covariances), of_share)
    return flat @ outer.ravel(), flat @ weight.ravel(), information


def _inverse_of_each(matrices: Floats) -> Floats:
    """Return the inverses of symmetric matrices (N, d, d) with a unit diagonal; of three rows by their cofactors.

    That takes a quarter of the time of numpy's inverse of so many small ones.
    """
    if matrices.shape[1] != 3:
        return np.asarray(np.linalg.inv(matrices))
    a, b, c = matrices[:, 0, 1], matrices[:, 0, 2], matrices[:, 1, 2]
    xx, yy, tt = 1.0 - c * c, 1.0 - b * b, 1.0 - a * a
    xy, xt, yt = b * c - a, a * c - b, a * b - c
    det = xx + a * xy + b * xt
    if not (det > _SINGULAR).all():
        return np.asarray(np.linalg.inv(matrices))
    return np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]]).transpose(2, 0, 1) / det[:, None, None]
