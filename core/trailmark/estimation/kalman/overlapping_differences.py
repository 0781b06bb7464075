"""How uncertain a sum over differences is that share poses and motion, so that their errors are not independent.

A pose that ends one difference begins the next, and its error counts once up and once down; differences over a long
way that begin a second apart have most of their motion in common; and errors of poses may last. All of it is in the
covariance of the sum: the errors of poses are a first-order Gauss-Markov process, those of motion a random walk.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats

__all__ = ["WeightedDifferences", "variance_of_sum"]

#: A correlation time in which nothing lasts until the next stamp [s].
_NO_TIME_S = 1e-9
#: Share of a variance, and variance, that rounding may have taken of it.
_ROUNDED, _NOTHING = 1e-9, 1e-30


@dataclass(frozen=True, slots=True, eq=False)
class WeightedDifferences:
    """Differences of poses of one localizer from one motion between them, and the weights of their sum.

    Attributes
    ----------
    since_s, stamp_s : (N,) float64
        Stamps of the poses of each [s].
    weights : (N, d) float64
        What each is multiplied by.
    covariances : (N, 3, d, d) float64
        Of the earlier pose, of the later, and of the motion.
    """

    since_s: Floats
    stamp_s: Floats
    weights: Floats
    covariances: Floats


def variance_of_sum(by_motion: list[list[WeightedDifferences]], correlation_s: float) -> float:
    """Return the variance of the sum of all weighted differences of one localizer.

    Parameters
    ----------
    by_motion : list of list of WeightedDifferences
        Those from each motion; errors of different motions are independent.
    correlation_s : float
        How long the errors of the poses last; 0 where each errs anew [s].
    """
    variance = sum(_variance_by_motion(of_one) for of_one in by_motion)
    every = [each for of_one in by_motion for each in of_one]
    stamps_s = np.concatenate([each.since_s for each in every] + [each.stamp_s for each in every])
    begun = [-_times_root(each.covariances[:, 0], each.weights) for each in every]
    ended = [_times_root(each.covariances[:, 1], each.weights) for each in every]
    errors = np.concatenate(begun + ended)
    stamps_s, index = np.unique(stamps_s, return_inverse=True)
    of_stamp = np.zeros((len(stamps_s), errors.shape[1]))
    np.add.at(of_stamp, index, errors)
    alike = np.exp(-np.abs(stamps_s[:, None] - stamps_s) / max(correlation_s, _NO_TIME_S))
    return variance + float(np.einsum("id,ij,jd->", of_stamp, alike, of_stamp, optimize=True))


def _variance_by_motion(of_one: list[WeightedDifferences]) -> float:
    """Return the part of the variance that is of the motion: over the time that two have in common they err alike."""
    since_s = np.concatenate([each.since_s for each in of_one])
    stamp_s = np.concatenate([each.stamp_s for each in of_one])
    errors = np.concatenate([_times_root(each.covariances[:, 2], each.weights) for each in of_one])
    errors /= np.sqrt(stamp_s - since_s)[:, None]
    common_s = np.minimum(stamp_s[:, None], stamp_s) - np.maximum(since_s[:, None], since_s)
    return float(((errors @ errors.T) * np.maximum(common_s, 0.0)).sum())


def _times_root(covariances: Floats, weights: Floats) -> Floats:
    """Return weights times roots of covariances, (N, d).

    The roots are upper triangular: a heading that moves what is far from where it was told keeps them so, and the
    same pose at the beginning of one difference and at the end of another has the same root but for this.
    """
    rounded = _ROUNDED * np.diagonal(covariances, axis1=1, axis2=2) + _NOTHING
    padded = covariances + rounded[:, :, None] * np.eye(covariances.shape[1])
    roots = np.linalg.cholesky(padded[:, ::-1, ::-1])[:, ::-1, ::-1]
    return np.asarray(np.einsum("nij,ni->nj", roots, weights))
