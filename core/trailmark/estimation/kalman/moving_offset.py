"""Absolute estimates that are drawn away: their offset has a velocity, which changes slowly.

Fixes that stand still while base moves, that creep, or go along at a wrong speed, are off by ever more. Of their next
one as much is known as of a body that goes on: their offset is followed by a filter of its own, with position and
velocity of each direction that is measured. Nothing is drawn away from a base that stands: there motions that stand
still would explain whatever absolute estimates say.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Pose2

if TYPE_CHECKING:
    from trailmark.estimation.kalman.state import FilterState

__all__ = ["MovingOffset", "moved_on"]

# Standard deviations of the velocity of an offset, and of its change in a second, by direction of the pose.
_VELOCITY = np.array([1.0, 1.0, 0.5])
_CHANGE = np.array([0.2, 0.2, 0.1])
# Slower than this base stands [m/s, rad/s].
_AT_REST_MPS, _AT_REST_RADPS = 0.02, math.radians(1.0)


class MovingOffset(NamedTuple):
    """An offset with a velocity, in standard deviations of the absolute estimates.

    Attributes
    ----------
    stamp_s, pose_odom_base
        Of the last absolute estimate: the instant [s], and base in odom.
    mean, rate : (k,) float64
        The offset and its velocity [1/s].
    variance, covariance, rate_variance : (k,) float64
        Of the mean, of the two, and of the rate.
    log : float
        Log likelihood of all absolute estimates.
    """

    stamp_s: float
    pose_odom_base: Pose2
    mean: Floats
    rate: Floats
    variance: Floats
    covariance: Floats
    rate_variance: Floats
    log: float = 0.0


def moved_on(
    known: MovingOffset | None,
    innovation: Floats,
    root: Floats,
    state: FilterState,
    *,
    most: float,
    modesty: float,
) -> MovingOffset:
    """Return what is known of a moving offset after one more absolute estimate.

    Parameters
    ----------
    known : MovingOffset or None
        What was known before; None before the first.
    innovation : (k,) float64
        By how much it differs from where motion leads, for unit noise.
    root : (k, 3) float64
        How the innovation changes with the pose.
    state : FilterState
        Before it.
    most : float
        A difference from what is expected, of so many standard deviations, begins another offset.
    modesty : float
        It costs no more than this to expect little.
    """
    stamp_s, pose_odom_base = state.stamp_s, state.odometry.pose_odom_base
    begun = MovingOffset(
        stamp_s,
        pose_odom_base,
        innovation,
        np.zeros(len(innovation)),
        np.ones(len(innovation)),
        np.zeros(len(innovation)),
        _squares(root, _VELOCITY),
    )
    if known is None or len(known.mean) != len(innovation):
        return begun
    dt_s = _moving_s(known, stamp_s, pose_odom_base)
    q = _squares(root, _CHANGE) * dt_s
    variance = known.variance + dt_s * (2.0 * known.covariance + dt_s * (known.rate_variance + q / 3.0))
    covariance = known.covariance + dt_s * (known.rate_variance + 0.5 * q)
    rate_variance = known.rate_variance + q
    away, spread = innovation - known.mean - dt_s * known.rate, variance + 1.0
    nis = float((away * away / spread).sum())
    log = known.log - min(0.5 * float(np.log(spread).sum()), modesty) - 0.5 * nis
    if nis > most * most:
        return begun._replace(log=log)
    gain, rate_gain = variance / spread, covariance / spread
    return MovingOffset(
        stamp_s,
        pose_odom_base,
        known.mean + dt_s * known.rate + gain * away,
        known.rate + rate_gain * away,
        variance - gain * variance,
        covariance - gain * covariance,
        rate_variance - rate_gain * covariance,
        log,
    )


def _squares(root: Floats, sigmas: Floats) -> Floats:
    """Return the variances of what is measured, (k,), of a change of the pose with such standard deviations."""
    return np.asarray(((root * sigmas) ** 2).sum(axis=1))


def _moving_s(known: MovingOffset, stamp_s: float, pose_odom_base: Pose2) -> float:
    """Return the time since the last absolute estimate [s]; none if base has stood."""
    dt_s, way = stamp_s - known.stamp_s, known.pose_odom_base.between(pose_odom_base)
    moves = math.hypot(way.x, way.y) > _AT_REST_MPS * dt_s or abs(way.theta) > _AT_REST_RADPS * dt_s
    return dt_s if moves else 0.0
