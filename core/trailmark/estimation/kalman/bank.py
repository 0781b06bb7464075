"""A bank of filters that disagree on whose motion is right, weighed by what absolute estimates say of each.

Multiple-model estimation (Magill, "Optimal adaptive estimation of sampled stochastic processes", IEEE Trans. Automatic
Control 10, 1965): each hypothesis is a filter of its own, its probability the likelihood of all that was measured. The
belief is the mixture. So it covers every hypothesis that is not refuted, and what is decided late is as if it had been
known from the beginning.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.diagnosis import FixOffset, RivalFilter
from trailmark.estimation.kalman.innovation import Innovation
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.kalman.moving_offset import moved_on
from trailmark.estimation.kalman.state import FilterState, Gaussian
from trailmark.estimation.kalman.witnesses import SUSPICION, with_testimony
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
    logs = np.array([rival.log_weight - SUSPICION * rival.is_implausible for rival in rivals])
    weights = np.exp(logs - logs.max())
    return np.asarray(weights / weights.sum())


def mixture_of(rivals: Sequence[RivalFilter], weights: Floats) -> Gaussian | None:
    """Return mean and covariance of the mixture; None while the pose is unknown."""
    known = [(rival.state.gaussian, float(w)) for rival, w in zip(rivals, weights) if rival.state.gaussian is not None]
    if not known:
        return None
    leader = known[int(np.argmax([w for _, w in known]))][0]
    centre = leader.x
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
    return Gaussian(x, covariance, leader.lasting)


def log_likelihood(seen: Innovation | None) -> float:
    """Return the log of the probability density of a measurement, to a constant; 0 while the pose is unknown."""
    if seen is None:
        return 0.0
    inverse = seen.inverse
    is_number = inverse.size == 1 and inverse.item() > 0.0
    log_det = math.log(inverse.item()) if is_number else float(np.linalg.slogdet(inverse)[1])
    return max(0.5 * log_det, -_MODESTY) - 0.5 * seen.nis


def log_likelihood_of_offset(
    state: FilterState, measurement: Measurement, offset: FixOffset | None
) -> tuple[float, FixOffset | None]:
    """Return the log of the density of a measurement that is off, and what is known of it then.

    It is off by a constant, or is late, or, where more motions agree against it, is drawn away: what explains all of
    them best counts. Beside one motion fixes that are drawn away and a motion that is wrong are the same.
    """
    if state.gaussian is None:
        return 0.0, offset
    innovation, jacobian = measurement.innovation(state.gaussian.x)
    if offset is None or len(offset.mean) != len(innovation):
        offset = FixOffset(np.zeros(len(innovation)))
    before, moving = offset.log, offset.moving
    fault = state.diagnosis.absolute_faults.get(measurement.source)
    if fault is not None and fault.is_outvoted:
        moving = moved_on(moving, innovation, jacobian[:, :3], state, most=_OTHER_LIE, modesty=_MODESTY)
    offset = _late_after(_constant_after(offset, innovation), innovation, jacobian, state)._replace(moving=moving)
    return offset.log - before, offset


def _constant_after(offset: FixOffset, innovation: Floats) -> FixOffset:
    """Return what is known of a constant offset.

    Of the first nothing is known, and nothing is lost: who lies by a constant says something only by its second lie.
    """
    if not offset.n:
        return offset._replace(mean=innovation, n=1)
    away, spread = innovation - offset.mean, 1.0 + 1.0 / offset.n
    log = offset.log_constant - 0.5 * len(away) * math.log(spread) - 0.5 * float(away @ away) / spread
    if float(away @ away) > _OTHER_LIE * _OTHER_LIE * spread:
        return offset._replace(mean=innovation, n=1, log_constant=log)
    n = min(offset.n + 1, _OFFSET_OF)
    return offset._replace(mean=offset.mean + away / n, n=n, log_constant=log)


def _late_after(offset: FixOffset, innovation: Floats, jacobian: Floats, state: FilterState) -> FixOffset:
    """Return what is known of a delay: a late pose lies behind by the way of that time, and is turned by its turn."""
    assert state.gaussian is not None
    twist, theta = state.odometry.twist, float(state.gaussian.x[2])
    cos, sin = math.cos(theta), math.sin(theta)
    ahead_mps = cos * twist.forward_mps - sin * twist.left_mps, sin * twist.forward_mps + cos * twist.left_mps
    slope = -jacobian[:, :3] @ (*ahead_mps, twist.yaw_radps)
    known = np.eye(len(innovation)) + jacobian @ state.gaussian.covariance @ jacobian.T
    after = _late_by(offset, innovation, slope, known)
    if after.log_late < offset.log_late - 0.5 * _OTHER_LIE * _OTHER_LIE:
        anew = offset._replace(late_s=0.0, variance_s2=FixOffset._field_defaults["variance_s2"])
        return max(after, _late_by(anew, innovation, slope, known), key=lambda one: one.log_late)
    return after


def _late_by(offset: FixOffset, innovation: Floats, slope: Floats, known: Floats) -> FixOffset:
    """Return a delay after one more innovation, which changes with it by a slope and has else a known covariance."""
    away = innovation - offset.late_s * slope
    spread = known + offset.variance_s2 * np.outer(slope, slope)
    weighed = np.linalg.solve(spread, np.column_stack([away, slope]))
    log = max(-0.5 * float(np.linalg.slogdet(spread)[1]), -_MODESTY) - 0.5 * float(away @ weighed[:, 0])
    gain = offset.variance_s2 * weighed[:, 1]
    return offset._replace(
        late_s=offset.late_s + float(gain @ away),
        variance_s2=offset.variance_s2 * (1.0 - float(gain @ slope)),
        log_late=offset.log_late + log,
    )


def log_odds_of_one(difference: float) -> float:
    """Return what one absolute estimate says of two hypotheses, given the difference of its log likelihoods."""
    return min(max(difference, -_MOST_OF_ONE), _MOST_OF_ONE)


def with_likelihoods(rivals: Sequence[RivalFilter], source: str, logs: Sequence[float]) -> list[RivalFilter]:
    """Return hypotheses after a measurement: how much it says is bounded, as it may be an outlier, or its localizer.

    Parameters
    ----------
    rivals : sequence of RivalFilter
        The hypotheses.
    source : str
        The localizer.
    logs : sequence of float
        Log likelihood of the measurement by each.
    """
    best = max(logs)
    said = [max(log - best, -_MOST_OF_ONE) for log in logs]
    after = [
        RivalFilter(
            rival.state,
            rival.log_weight + log,
            rival.n_measurements + 1,
            rival.is_implausible,
            rival.offsets,
            rival.begun,
            rival.log_votes,
            rival.heard,
            rival.log_alone,
        )
        for rival, log in zip(rivals, said)
    ]
    return with_testimony(after, source, said)


def is_jump(before: Twist2, after: Twist2, dt_s: float, *, position_m2: float, turn_rad2: float) -> bool:
    """Return whether a velocity has changed faster than robots do, given the variances of the step."""
    speed = math.hypot(after.forward_mps - before.forward_mps, after.left_mps - before.left_mps)
    turn = abs(after.yaw_radps - before.yaw_radps)
    speed_sigma = math.hypot(_ACCELERATION_MPS2 * dt_s, math.sqrt(2.0 * position_m2) / dt_s)
    turn_sigma = math.hypot(_ACCELERATION_RADPS2 * dt_s, math.sqrt(2.0 * turn_rad2) / dt_s)
    return speed > _JUMP * speed_sigma or turn > _JUMP * turn_sigma
