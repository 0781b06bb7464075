"""Motion that is wrong, but no invention: wheels that slip a little, a gyro with a bias, a clock that is late."""

from __future__ import annotations

import math
from dataclasses import replace

from trailmark.estimation.kalman.motions import MotionStep
from trailmark.estimation.symmetric import add, diagonal

__all__ = ["make_rough"]

# By which share of the way, and which yaw rate, it errs (one standard deviation), the same way for so long [rad/s, s].
_SHARE, _YAW_RADPS, _LASTS_S = 0.3, math.radians(5.0), 1.0


def make_rough(step: MotionStep, dt_s: float) -> MotionStep:
    """Return a step with the uncertainty of one that is about right.

    Parameters
    ----------
    step : MotionStep
        As it was told.
    dt_s : float
        Its length [s].
    """
    if step.covariance is None:
        return step
    times = _LASTS_S / dt_s  # an error that lasts, as the random walk that has gone as far by then
    away_m2 = _SHARE**2 * (step.x**2 + step.y**2) * times
    doubt = diagonal(away_m2, away_m2, (_YAW_RADPS * dt_s) ** 2 * times)
    return replace(step, covariance=add(step.covariance, doubt))
