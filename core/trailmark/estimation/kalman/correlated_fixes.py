"""Absolute poses whose errors last: how much of one is news after the one before.

The errors of a localizer that matches against a map, or tells a filtered posterior, are alike from one pose to the
next. They are taken for a first-order Gauss-Markov process with the correlation ``r = exp(-dt / tau)`` after dt. Of n
looks at something that stands still, with unit variance each, the information is then ``1 + (n - 1) (1 - r) / (1 + r)``
(the sum of the elements of the inverse of the AR(1) correlation matrix): the first counts whole, each that follows by
``(1 - r) / (1 + r) = tanh(dt / 2 tau)``.
"""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Floats

__all__ = ["innovation_moments", "share_of_news"]

#: Whatever lasts, a single look tells where the robot is to its whole error: the variance after one is at most this
#: times that. With one, errors stay within 1.2 of those of the optimal filter, which has the error as a state, and NEES
#: within 0.8 and 1.3, for motion of 1e-5 to 1 of the variance of a look between looks and r to 0.98; without this bound
#: errors are 2.3 times the optimum where motion is as uncertain as a look.
_MOST_AFTER = 1.0
_LEAST_SHARE = 1e-9


def share_of_news(dt_s: float, correlation_s: float, spread: Floats) -> Floats:
    """Return which share of the information of a pose that follows another is new, (k,).

    Parameters
    ----------
    dt_s : float
        Time since the one before of the same localizer [s].
    correlation_s : float
        Time in which its errors last, above zero [s].
    spread : (k,) float64
        Variance of the predicted measurement, row by row, in variances of the measurement. Where the belief has
        become less certain than a look by itself is, by motion meanwhile, the look counts for more than its news.
    """
    share = math.tanh(0.5 * dt_s / correlation_s)
    restored = 1.0 / _MOST_AFTER - 1.0 / np.maximum(spread, _LEAST_SHARE)
    return np.asarray(np.clip(restored, max(share, _LEAST_SHARE), 1.0))


def innovation_moments(r: float, gain: float, lost: float) -> tuple[float, float, float, float]:
    """Return what a steady filter's innovations look like if the looks err as an AR(1) process.

    The error of the belief after a look is ``x' = (1 - K) (x + q) + K e'`` with ``e' = r e + w``, so in the steady
    state ``E[x e] = K / (1 - (1 - K) r) = g``, and the moments of the innovation ``e' - x - q`` follow.

    Parameters
    ----------
    r : float
        Correlation of the error of one look with the next.
    gain : float
        Gain K of the filter, between 0 and 1.
    lost : float
        Variance q that motion adds to the belief between looks.

    Returns
    -------
    (float, float, float, float)
        Variance of the innovation and its covariance with the next: per variance of a look, and from motion.
    """
    kept = 1.0 - gain
    g = gain / (1.0 - kept * r)
    settled = 1.0 - kept * kept
    of_looks = (gain * gain + 2.0 * kept * gain * r * g) / settled
    of_motion = kept * kept / settled
    variance = 1.0 + of_looks - 2.0 * r * g
    covariance = r * (1.0 - r * g) - (r * g - of_looks + gain * variance)
    from_motion = of_motion + 1.0
    return variance, covariance, from_motion * lost, (from_motion - gain * from_motion) * lost
