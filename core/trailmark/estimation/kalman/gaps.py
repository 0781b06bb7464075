"""How base moves while nothing, or not everything, measures it, and how uncertain its way becomes.

What is unknown then is a speed, and it lasts: standard deviations of the way grow with time, not with its root.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from trailmark.arrays import Floats
from trailmark.estimation.kalman.motions import MotionStep
from trailmark.estimation.kalman.state import FilterState, OdometryState
from trailmark.estimation.kalman.velocity import VelocityModel
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.smoother_config import SmootherConfig
from trailmark.estimation.symmetric import Sym3, add, diagonal, scaled
from trailmark.estimation.unmeasured import (
    EVERYWHERE,
    NOWHERE,
    Sym2,
    longest,
    plus,
    projected,
    speed_variance,
    squared_beyond,
    turned,
    unmeasured_in,
)
from trailmark.geometry import Twist2

__all__ = ["AT_REST", "Gaps", "Piece", "drift_of"]

AT_REST = Twist2()
# A speed of so many standard deviations of one that nobody measured is covered by them.
_COVERED = 2.0


def drift_of(config: KalmanConfig | SmootherConfig) -> Sym3:
    """Return the covariance of a step of 1 s that nobody measured."""
    drift_mps, drift_radps = config.drift_sigma_mps, math.radians(config.drift_sigma_deg_per_s)
    return diagonal(drift_mps**2, drift_mps**2, drift_radps**2)


class Piece(NamedTuple):
    """A piece of time, and how base moves in it.

    Attributes
    ----------
    step : MotionStep
        The motion.
    driven_s : float
        For how long the velocity is counted as way travelled [s].
    gap_s : float
        At its end, how long nothing has measured motion; 0 where something did [s].
    is_measured : bool
        Whether all of the motion was measured.
    columns : (3, n) float64 or None
        How the step changes with the state, where it depends on common errors.
    velocity_held_s : float
        For how long the estimated velocity moves the pose; 0 where motion is measured [s].
    unmeasured_s : Sym2
        At its end, for how long nobody has measured the way, by direction in odom [s].
    """

    step: MotionStep
    driven_s: float
    gap_s: float = 0.0
    is_measured: bool = False
    columns: Floats | None = None
    velocity_held_s: float = 0.0
    unmeasured_s: Sym2 = NOWHERE


class Gaps:
    """Moves base over gaps.

    In a gap of length ``b`` the last twist is held for ``coast_s``, from there on base is taken to stand. The variance
    of its way is ``drift^2 b^2``, because an unknown speed lasts: until a motion or an absolute estimate measures it.
    After ``coast_s`` the speed is as uncertain as the last one was fast, where that is more than drift: a robot may go
    on. Cut into pieces, a gap is as uncertain as in one piece. With the model `velocity` a gap goes on with the
    estimated velocity. A direction that all motions leave open is as uncertain as a gap.

    Parameters
    ----------
    config : KalmanConfig
        Of the estimator.
    velocity : VelocityModel or None
        Of the model `velocity`.
    """

    def __init__(self, config: KalmanConfig, velocity: VelocityModel | None) -> None:
        self._drift = drift_of(config)
        self._coast_s = config.coast_s
        self._velocity = velocity

    def drift_of_step(self, dt_s: float) -> Sym3:
        """Return the covariance of a step that goes on with the velocity before."""
        return scaled(self._drift, dt_s * dt_s)

    def drift_over(self, dt_s: float) -> Sym3:
        """Return the covariance of a step that nobody measured, one of many whose velocities change in ``coast_s``."""
        return scaled(self._drift, dt_s * self._coast_s)

    def guess(self, odometry: OdometryState, doubted: Sequence[MotionStep], dt_s: float) -> Twist2:
        """Return how base is taken to move in a direction that no motion that is believed measures.

        As the only motion says that is not believed, if a gap covers its speed: wheels that are accused of a wrong turn
        tell the way along a corridor better than the velocity before. It is as uncertain as a gap, all the same.
        """
        if len(doubted) != 1 or doubted[0].covariance is None:
            return odometry.twist
        most_mps = _COVERED * math.sqrt(speed_variance(self._drift, odometry.measured_mps))
        return doubted[0].twist if math.hypot(doubted[0].x, doubted[0].y) <= most_mps * dt_s else odometry.twist

    def coast(self, state: FilterState, stamp_s: float) -> Piece:
        """Return a piece of time in which nothing measured motion."""
        odometry = state.odometry
        dt_s = stamp_s - state.stamp_s
        begin_s, end_s = odometry.gap_s, odometry.gap_s + dt_s
        if self._velocity is not None and state.gaussian is not None:
            step, held_s = self._velocity.coast(state.gaussian.x, dt_s)
            piece = Piece(step, held_s, gap_s=end_s, velocity_held_s=held_s)
            return self._with_lasting_speed(piece, odometry, dt_s)
        held_s = min(end_s, self._coast_s) - min(begin_s, self._coast_s)
        ahead = odometry.twist.after(held_s)
        noise = scaled(self._drift, self._spread(end_s) - self._spread(begin_s))
        twist = odometry.twist if held_s > 0.0 else AT_REST
        step = MotionStep(ahead.x, ahead.y, ahead.theta, noise, None, twist)
        return self._with_lasting_speed(Piece(step, held_s, gap_s=end_s), odometry, dt_s)

    def with_lasting_error(self, piece: Piece, odometry: OdometryState, dt_s: float) -> Piece:
        """Return a piece with what an unknown speed, the same as in the pieces before, adds where nobody measured."""
        step, theta = piece.step, odometry.pose_odom_base.theta
        assert step.covariance is not None
        open_ways = unmeasured_in(step.covariance, self.drift_over(dt_s))
        before_s = projected(turned(odometry.unmeasured_s, -theta), open_ways)
        after_s = plus(before_s, open_ways, dt_s)
        unmeasured_s = turned(after_s, theta)
        if longest(after_s) <= self._coast_s:
            return _unmeasured(piece, step.covariance, unmeasured_s)
        speed_m2ps2 = speed_variance(self._drift, odometry.measured_mps)
        rate_m2ps2 = speed_m2ps2 * dt_s * (2.0 - self._coast_s / longest(after_s))
        xx, xy, yy = after_s
        lasting = (rate_m2ps2 * xx, rate_m2ps2 * xy, 0.0, rate_m2ps2 * yy, 0.0, 0.0)
        return _unmeasured(piece, add(step.covariance, lasting), unmeasured_s)

    def _with_lasting_speed(self, piece: Piece, odometry: OdometryState, dt_s: float) -> Piece:
        """Return a piece of a gap with what a speed adds that has been unknown for longer than ``coast_s``."""
        before_s = odometry.unmeasured_s
        after_s = plus(before_s, EVERYWHERE, dt_s)
        assert piece.step.covariance is not None
        if longest(after_s) <= self._coast_s:
            return _unmeasured(piece, piece.step.covariance, after_s)
        speed_m2ps2 = speed_variance(self._drift, odometry.measured_mps)
        added = plus(squared_beyond(after_s, self._coast_s), squared_beyond(before_s, self._coast_s), -1.0)
        xx, xy, yy = turned(added, -odometry.pose_odom_base.theta)
        lasting = (speed_m2ps2 * xx, speed_m2ps2 * xy, 0.0, speed_m2ps2 * yy, 0.0, 0.0)
        return _unmeasured(piece, add(piece.step.covariance, lasting), after_s)

    def _spread(self, gap_s: float) -> float:
        """Return the variance of the way in a gap, for a unit drift [s^2]."""
        coast_s = self._coast_s
        return gap_s * gap_s if gap_s < coast_s else coast_s * (2.0 * gap_s - coast_s)


def _unmeasured(piece: Piece, covariance: Sym3, unmeasured_s: Sym2) -> Piece:
    """Return a piece whose step has another covariance, in a third of the time of replacing both."""
    step, driven_s, gap_s, is_measured, columns, held_s, _ = piece
    if covariance is not step.covariance:
        step = MotionStep(step.x, step.y, step.turn, covariance, None, step.twist, step.matched_share)
    return Piece(step, driven_s, gap_s, is_measured, columns, held_s, unmeasured_s)
