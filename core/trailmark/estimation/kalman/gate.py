"""Whether an innovation can be chance, and how much weight it keeps."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from scipy.special import gammaincinv

from trailmark.arrays import Floats
from trailmark.estimation.kalman_config import Loss
from trailmark.frames.payloads import read_only

__all__ = ["NOTHING_BESIDE", "SHARE_UNDECIDED", "threshold", "weight"]

#: Probability of who contradicts the belief while nothing decides: at odds of 1 to 4, with the belief at its centre,
#: the other is 2.3 standard deviations off, and 3.2 in the mean of two directions.
SHARE_UNDECIDED = 1.0 / 5.0
#: What is added to the covariance of a belief that nobody contradicts, (3, 3).
NOTHING_BESIDE: Floats = read_only(np.zeros((3, 3)))


@lru_cache(maxsize=64)
def threshold(probability: float, dof: int) -> float:
    """Return the NIS that a right estimate stays below with this probability: the quantile of chi-square."""
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
