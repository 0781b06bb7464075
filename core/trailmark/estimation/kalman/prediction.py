"""Carrying the filter on in time: with the motion that was measured, or with the last velocity."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from trailmark.estimation.kalman.common_errors import CommonErrors
from trailmark.estimation.kalman.correction import Filter
from trailmark.estimation.kalman.ekf import Moves
from trailmark.estimation.kalman.layout import Layout
from trailmark.estimation.kalman.motions import Motions, Step
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.kalman.velocity import VelocityModel
from trailmark.estimation.kalman.weighing import Judged, fused, judged
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.symmetric import congruence, diagonal, scaled
from trailmark.geometry import Pose2, Twist2, wrap_angle

__all__ = ["Prediction"]

Array = npt.NDArray[np.float64]

_AT_REST = Twist2()


class Prediction:
    """Predicts a filter state to a later stamp.

    Motion adds its own covariance and nothing else: at standstill the belief grows as little as the localizer says.
    In a gap of length ``b`` the last twist is held for ``coast_s`` and the variance is ``drift^2 b^2``, from there on
    base is taken to stand and it grows in proportion to time; cut into pieces, a gap is as uncertain as in one piece.
    With the model `velocity` a gap goes on with the estimated velocity.

    Parameters
    ----------
    config : KalmanConfig
        Of the estimator.
    motions : Motions
        What is known of motion.
    kalman : Filter
        Does the arithmetic.
    layout : Layout
        Of the state.
    gate_of : callable
        Probability with which a right motion of a localizer passes its test; None: no test.
    """

    def __init__(
        self,
        config: KalmanConfig,
        motions: Motions,
        kalman: Filter,
        layout: Layout,
        gate_of: Callable[[str], float | None],
    ) -> None:
        self._motions = motions
        self._filter = kalman
        self._layout = layout
        self._gate_of = gate_of
        self._coast_s = config.coast_s
        self._is_independent = config.motions == "independent"
        drift_mps, drift_radps = config.drift_sigma_mps, math.radians(config.drift_sigma_deg_per_s)
        self._drift = diagonal(drift_mps**2, drift_mps**2, drift_radps**2)
        self._common = CommonErrors(layout, kalman, self._is_independent)
        self._velocity = VelocityModel(layout, kalman, config.coast_s) if layout.has_velocity else None

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
        return replace(self._coasted(ahead, gap_s), stamp_s=-math.inf, gap_s=0.0, supports={}, suspects={})

    def _over(self, state: FilterState, stamp_s: float) -> FilterState:
        """Predict over a piece of time in which no motion begins or ends."""
        told = self._motions.steps(state.stamp_s, stamp_s)
        if not told:
            return self._coasted(state, stamp_s)
        dt_s = stamp_s - state.stamp_s
        verdict = Judged(told)
        if len(told) > 1:
            verdict = judged(told, dt_s, state.twist, scaled(self._drift, dt_s * dt_s), self._gate_of)
        if self._layout.common and state.x is not None:
            return self._with_common_errors(state, stamp_s, verdict)
        return self._measured(state, stamp_s, verdict, [step for _, step in verdict.steps], None)

    def _with_common_errors(self, state: FilterState, stamp_s: float, verdict: Judged) -> FilterState:
        assert state.x is not None
        assert state.covariance is not None
        dt_s = stamp_s - state.stamp_s
        drift = self._unmeasured(dt_s)
        x, covariance = self._common.learned(state.x, state.covariance, verdict.steps, dt_s, state.twist, drift)
        state = replace(state, x=x, covariance=covariance)
        steps = self._common.freed(x, verdict.steps, dt_s)
        return self._measured(state, stamp_s, verdict, steps, self._common.columns(x, verdict.steps, dt_s, drift))

    def _unmeasured(self, dt_s: float) -> tuple[float, float, float, float, float, float]:
        return scaled(self._drift, dt_s * self._coast_s)

    def _measured(
        self, state: FilterState, stamp_s: float, verdict: Judged, steps: Sequence[Step], columns: Array | None
    ) -> FilterState:
        dt_s = stamp_s - state.stamp_s
        step, is_measured = fused(steps, dt_s, state.twist, self._unmeasured(dt_s), self._is_independent)
        moved = self._moved(state, stamp_s, step, dt_s, 0.0, is_measured, columns)
        if self._velocity is not None and moved.x is not None:
            moved = self._velocity.measured(moved, steps, dt_s, columns)
        if not (verdict.checks or state.left_out or state.checks):
            return moved
        left_out = {source: state.left_out.get(source, 0) + 1 for source in verdict.left_out}
        return replace(moved, left_out=left_out, checks=verdict.checks)

    def _coasted(self, state: FilterState, stamp_s: float) -> FilterState:
        begin_s, end_s = state.gap_s, state.gap_s + stamp_s - state.stamp_s
        if self._velocity is not None and state.x is not None:
            step, held_s = self._velocity.ahead(state.x, stamp_s - state.stamp_s)
            moved = self._moved(state, stamp_s, step, held_s, end_s, False, None, held_s)
            return replace(moved, twist=self._velocity.twist_of(moved))
        held_s = min(end_s, self._coast_s) - min(begin_s, self._coast_s)
        ahead = state.twist.after(held_s)
        noise = scaled(self._drift, self._spread(end_s) - self._spread(begin_s))
        twist = state.twist if held_s > 0.0 else _AT_REST
        step = Step(ahead.x, ahead.y, ahead.theta, noise, None, twist)
        return self._moved(state, stamp_s, step, held_s, end_s, False, None)

    def _spread(self, gap_s: float) -> float:
        """Return the variance of the way in a gap, for a unit drift [s^2]."""
        coast_s = self._coast_s
        return gap_s * gap_s if gap_s < coast_s else coast_s * (2.0 * gap_s - coast_s)

    def _moved(
        self,
        state: FilterState,
        stamp_s: float,
        step: Step,
        driven_s: float,
        gap_s: float,
        is_measured: bool,
        columns: Array | None,
        held_s: float = 0.0,
    ) -> FilterState:
        x, covariance = state.x, state.covariance
        if x is not None and covariance is not None:
            moves = self._moves(x, step, stamp_s - state.stamp_s, columns, held_s)
            x, covariance = self._filter.moved(x, covariance, moves)
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
            state.suspects,
            state.n_recoveries,
        )

    def _moves(self, x: Array, step: Step, dt_s: float, columns: Array | None, held_s: float) -> Moves:
        numbers = x.tolist()
        px, py, theta = numbers[:3]
        cos, sin = math.cos(theta), math.sin(theta)
        dx, dy = cos * step.x - sin * step.y, sin * step.x + cos * step.y
        assert step.covariance is not None
        xx, xy, xt, yy, yt, tt = congruence(step.covariance, cos, sin, 0.0, 0.0)
        moved = np.array([px + dx, py + dy, wrap_angle(theta + step.turn), *numbers[3:]])
        jacobian = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        noise = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
        if len(numbers) == 3:
            return Moves(moved, jacobian, noise, (step.x, step.y, step.turn))
        turned = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        whole, spread = np.eye(len(x)), np.zeros((len(x), len(x)))
        whole[:3, :3], spread[:3, :3] = jacobian, noise
        if columns is not None:
            whole[:3] += turned @ columns
        if self._velocity is not None:
            self._velocity.carry(moved, whole, spread, turned, dt_s, held_s)
        self._common.wander(spread, dt_s)
        return Moves(moved, whole, spread, (step.x, step.y, step.turn))
