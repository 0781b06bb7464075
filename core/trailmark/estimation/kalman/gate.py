"""Whether an innovation can be chance, and how much weight it keeps."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman_config import Loss
from trailmark.frames.payloads import read_only

__all__ = ["NOTHING_BESIDE", "SHARE_UNDECIDED", "threshold", "weight"]

#: Probability of who contradicts the belief while nothing decides: at odds of 1 to 4, with the belief at its centre,
#: the other is 2.3 standard deviations off, and 3.2 in the mean of two directions.
SHARE_UNDECIDED = 1.0 / 5.0
#: What is added to the covariance of a belief that nobody contradicts, (3, 3).
NOTHING_BESIDE: Floats = read_only(np.zeros((3, 3)))
# Quantiles of chi-square for 1, 2 and 3 degrees of freedom, by probability: the import of scipy, which knows all,
# takes longer than that of the whole estimator.
_QUANTILES = {
    0.8: (1.642374415149818, 3.218875824868201, 4.64162767608745),
    0.95: (3.841458820694124, 5.991464547107979, 7.814727903251179),
    0.99: (6.6348966010212145, 9.21034037197618, 11.344866730144373),
    0.997: (8.807468393511947, 11.618285980628052, 13.931422665512084),
    0.999: (10.827566170662733, 13.815510557964274, 16.26623619623813),
    0.9993302020246445: (11.571238322479248, 14.617068840737062, 17.113357734109773),
    0.99999: (19.511420964666268, 23.02585092994956, 25.90174974567149),
}


@lru_cache(maxsize=64)
def threshold(probability: float, dof: int) -> float:
    """Return the NIS that a right estimate stays below with this probability: the quantile of chi-square."""
    known = _QUANTILES.get(probability)
    if known is not None and 1 <= dof <= 3:
        return known[dof - 1]
    from scipy.special import gammaincinv

    return float(2.0 * gammaincinv(dof / 2.0, probability))


def weight(loss: Loss, nis: float, dof: int, scale: float) -> float:
    """Return the weight of an estimate: 1 near the belief, less with distance.

    That of an iteratively reweighted least-squares step; the distance is in standard deviations of the innovation.
    """
    distance = math.sqrt(nis / dof) / scale
    if loss == "cauchy":
        return 1.0 / (1.0 + distance * distance)
    if loss == "huber" and distance > 1.0:
        return 1.0 / distance
    return 1.0
