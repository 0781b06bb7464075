"""A bank of filters that disagree on whose motion is right, weighed by what absolute estimates say of each.

Multiple-model estimation (Magill, "Optimal adaptive estimation of sampled stochastic processes", IEEE Trans. Automatic
Control 10, 1965): each hypothesis is a filter of its own, its probability the likelihood of all that was measured. The
belief is the mixture. So it covers every hypothesis that is not refuted, and what is decided late is as if it had been
known from the beginning.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.innovation import Innovation
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.kalman.state import FilterState, FixOffset, Gaussian, RivalFilter
from trailmark.geometry import Twist2, wrap_angle

__all__ = [
    "is_jump",
    "log_likelihood",
    "log_likelihood_of_offset",
    "log_odds_of_one",
    "mixture_of",
    "posterior",
    "with_likelihoods",
]

# Of a hypothesis by which a moving robot stands still at once, or jumps: what suspicion alone can say. At odds of 16 to
# 1 the truth is never further than 4 standard deviations from the mixture, whoever is right.
_SUSPICION = math.log(16.0)
# One absolute estimate says no more than this of two hypotheses: it may be an outlier itself, one of twenty is.
_MOST_OF_ONE = math.log(20.0)
# Nor does it cost more than this that a hypothesis expects little: between motion that is wrong, which leaves the next
# place open, and absolute estimates that are off by a constant, which leave nothing open.
_MODESTY = 5.0
# Speed changes of a robot, as standard deviations: 4 of them are what tyres can do [m/s^2, rad/s^2].
_ACCELERATION_MPS2, _ACCELERATION_RADPS2 = 1.0, 5.0
_JUMP = 4.0
# An offset is the mean of no more than so many absolute estimates: it may change slowly. A change at once, of so many
# standard deviations, begins another lie.
_OFFSET_OF, _OTHER_LIE = 40, 5.0


def posterior(rivals: Sequence[RivalFilter]) -> Floats:
    """Return the probabilities of hypotheses, (n,)."""
    logs = np.array([rival.log_weight - _SUSPICION * rival.is_implausible for rival in rivals])
    weights = np.exp(logs - logs.max())
    return np.asarray(weights / weights.sum())


def mixture_of(rivals: Sequence[RivalFilter], weights: Floats) -> Gaussian | None:
    """Return mean and covariance of the mixture; None while the pose is unknown."""
    known = [(rival.state.gaussian, float(w)) for rival, w in zip(rivals, weights) if rival.state.gaussian is not None]
    if not known:
        return None
    centre = known[int(np.argmax([w for _, w in known]))][0].x
    away = []
    for gaussian, _ in known:
        difference = gaussian.x - centre
        difference[2] = wrap_angle(float(difference[2]))
        away.append(difference)
    shares = np.array([w for _, w in known]) / sum(w for _, w in known)
    mean = shares @ np.array(away)
    covariance = sum(
        (
            share * (gaussian.covariance + np.outer(one - mean, one - mean))
            for share, one, (gaussian, _) in zip(shares, away, known)
        ),
        start=np.zeros_like(known[0][0].covariance),
    )
    x = centre + mean
    x[2] = wrap_angle(float(x[2]))
    return Gaussian(x, covariance)


def log_likelihood(state: FilterState, measurement: Measurement) -> float:
    """Return the log of the probability density of a measurement, to a constant."""
    if state.gaussian is None:
        return 0.0
    seen = Innovation(*measurement.innovation(state.gaussian.x), state.gaussian.covariance)
    _, log_det = np.linalg.slogdet(seen.inverse)
    return max(0.5 * float(log_det), -_MODESTY) - 0.5 * seen.nis


def log_likelihood_of_offset(
    state: FilterState, measurement: Measurement, offset: FixOffset | None
) -> tuple[float, FixOffset | None]:
    """Return the log of the density of a measurement that is off by a constant, and what is known of it then.

    Of the first nothing is known, and nothing is lost: who lies by a constant says something only by its second lie.
    """
    if state.gaussian is None:
        return 0.0, offset
    innovation, _ = measurement.innovation(state.gaussian.x)
    if offset is None or len(offset.mean) != len(innovation):
        return 0.0, FixOffset(innovation, 1)
    away, spread = innovation - offset.mean, 1.0 + 1.0 / offset.n
    log = -0.5 * len(away) * math.log(spread) - 0.5 * float(away @ away) / spread
    if float(away @ away) > _OTHER_LIE * _OTHER_LIE * spread:
        return log, FixOffset(innovation, 1)
    n = min(offset.n + 1, _OFFSET_OF)
    return log, FixOffset(offset.mean + away / n, n)


def log_odds_of_one(difference: float) -> float:
    """Return what one absolute estimate says of two hypotheses, given the difference of its log likelihoods."""
    return min(max(difference, -_MOST_OF_ONE), _MOST_OF_ONE)


def with_likelihoods(rivals: Sequence[RivalFilter], logs: Sequence[float]) -> list[RivalFilter]:
    """Return hypotheses after a measurement: how much it says is bounded, as it may be an outlier."""
    best = max(logs)
    return [
        replace(
            rival,
            log_weight=rival.log_weight + max(log - best, -_MOST_OF_ONE),
            n_measurements=rival.n_measurements + 1,
        )
        for rival, log in zip(rivals, logs)
    ]


def is_jump(before: Twist2, after: Twist2, dt_s: float, *, position_m2: float, turn_rad2: float) -> bool:
    """Return whether a velocity has changed faster than robots do, given the variances of the step."""
    speed = math.hypot(after.forward_mps - before.forward_mps, after.left_mps - before.left_mps)
    turn = abs(after.yaw_radps - before.yaw_radps)
    speed_sigma = math.hypot(_ACCELERATION_MPS2 * dt_s, math.sqrt(2.0 * position_m2) / dt_s)
    turn_sigma = math.hypot(_ACCELERATION_RADPS2 * dt_s, math.sqrt(2.0 * turn_rad2) / dt_s)
    return speed > _JUMP * speed_sigma or turn > _JUMP * turn_sigma
