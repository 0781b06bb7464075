"""Carrying the filter on in time: with the motion that was measured, or with the last velocity."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from trailmark.estimation.kalman.ekf import PoseEkf
from trailmark.estimation.kalman.motions import Motions, Step, fused
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.symmetric import congruence, diagonal, scaled
from trailmark.geometry import Pose2, Twist2, wrap_angle

__all__ = ["Prediction"]

_AT_REST = Twist2()


class Prediction:
    """Predicts a filter state to a later stamp.

    Motion adds its own covariance and nothing else: at standstill the belief grows as little as the localizer says.
    In a gap of length ``b`` the last twist is held for ``coast_s`` and the variance is ``drift^2 b^2``, from there on
    base is taken to stand and it grows in proportion to time; cut into pieces, a gap is as uncertain as in one piece.
    """

    def __init__(self, config: KalmanConfig, motions: Motions, ekf: PoseEkf) -> None:
        self._motions = motions
        self._ekf = ekf
        self._coast_s = config.coast_s
        self._is_independent = config.motions == "independent"
        drift_mps, drift_radps = config.drift_sigma_mps, math.radians(config.drift_sigma_deg_per_s)
        self._drift = diagonal(drift_mps**2, drift_mps**2, drift_radps**2)

    def predicted(self, state: FilterState, stamp_s: float) -> FilterState:
        """Return the state at a stamp that is not earlier."""
        if stamp_s <= state.stamp_s:
            return state
        if state.stamp_s == -math.inf:
            return replace(state, stamp_s=stamp_s)
        for cut_s in self._motions.cuts(state.stamp_s, stamp_s):
            state = self._over(state, cut_s)
        return self._over(state, stamp_s)

    def doubted(self, state: FilterState, gap_s: float) -> FilterState:
        """Return a state that starts anew at any time, as uncertain as after a gap."""
        ahead = replace(state, stamp_s=0.0, gap_s=0.0, twist=_AT_REST)
        return replace(self._coasted(ahead, gap_s), stamp_s=-math.inf, gap_s=0.0, supports={})

    def _over(self, state: FilterState, stamp_s: float) -> FilterState:
        """Predict over a piece of time in which no motion begins or ends."""
        steps = self._motions.steps(state.stamp_s, stamp_s)
        if not steps:
            return self._coasted(state, stamp_s)
        dt_s = stamp_s - state.stamp_s
        unmeasured = scaled(self._drift, dt_s * self._coast_s)
        step, is_measured = fused(steps, dt_s, state.twist, unmeasured, self._is_independent)
        return self._moved(state, stamp_s, step, dt_s, 0.0, is_measured)

    def _coasted(self, state: FilterState, stamp_s: float) -> FilterState:
        begin_s, end_s = state.gap_s, state.gap_s + stamp_s - state.stamp_s
        held_s = min(end_s, self._coast_s) - min(begin_s, self._coast_s)
        ahead = state.twist.after(held_s)
        noise = scaled(self._drift, self._spread(end_s) - self._spread(begin_s))
        twist = state.twist if held_s > 0.0 else _AT_REST
        step = Step(ahead.x, ahead.y, ahead.theta, noise, None, twist)
        return self._moved(state, stamp_s, step, held_s, end_s, False)

    def _spread(self, gap_s: float) -> float:
        """Return the variance of the way in a gap, for a unit drift [s^2]."""
        coast_s = self._coast_s
        return gap_s * gap_s if gap_s < coast_s else coast_s * (2.0 * gap_s - coast_s)

    def _moved(
        self, state: FilterState, stamp_s: float, step: Step, driven_s: float, gap_s: float, is_measured: bool
    ) -> FilterState:
        x, covariance = state.x, state.covariance
        if x is not None and covariance is not None:
            px, py, theta = x.tolist()
            cos, sin = math.cos(theta), math.sin(theta)
            dx, dy = cos * step.x - sin * step.y, sin * step.x + cos * step.y
            assert step.covariance is not None
            xx, xy, xt, yy, yt, tt = congruence(step.covariance, cos, sin, 0.0, 0.0)
            covariance = self._ekf.moved(
                x := np.array([px + dx, py + dy, wrap_angle(theta + step.turn)]),
                covariance,
                np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]]),
                np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]]),
            )
        twist = step.twist
        return FilterState(
            stamp_s,
            x,
            covariance,
            twist,
            gap_s,
            is_measured,
            state.has_moved or gap_s == 0.0,
            state.odom @ Pose2(step.x, step.y, step.turn),
            state.travelled_m + math.hypot(twist.forward_mps, twist.left_mps) * driven_s,
            state.fixed_at_m,
            state.rejected,
            state.supports,
            state.n_recoveries,
        )
