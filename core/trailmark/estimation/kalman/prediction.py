"""Carrying the filter on in time: with the motion that was measured, or with the last velocity."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.agreement import Tolerance
from trailmark.estimation.kalman.common_errors import CommonErrors
from trailmark.estimation.kalman.correction import Filter
from trailmark.estimation.kalman.diagnosis import FaultDiagnosis, MotionSum
from trailmark.estimation.kalman.ekf import PredictedMotion
from trailmark.estimation.kalman.gaps import AT_REST, Gaps, Piece
from trailmark.estimation.kalman.lasting_doubts import with_doubts
from trailmark.estimation.kalman.lasting_errors import carry_columns
from trailmark.estimation.kalman.layout import Layout
from trailmark.estimation.kalman.matched_motion import (
    NO_OFFSETS,
    Offset,
    offsets_after,
    with_lasting_error,
    with_offsets,
)
from trailmark.estimation.kalman.motions import Motions, MotionStep
from trailmark.estimation.kalman.moved_belief import on_another_clock
from trailmark.estimation.kalman.parting import without_window
from trailmark.estimation.kalman.rough_motion import make_rough
from trailmark.estimation.kalman.standstill import stands, with_standstill
from trailmark.estimation.kalman.state import FilterState, Gaussian, OdometryState
from trailmark.estimation.kalman.velocity import VelocityModel
from trailmark.estimation.kalman.weighing import StepSelection, fuse_steps, replace_impossible_jump, select_steps
from trailmark.estimation.kalman.windows import without_windows
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.symmetric import congruence, frozen_matrix
from trailmark.estimation.unmeasured import NOWHERE
from trailmark.geometry import Pose2, wrap_angle

__all__ = ["Prediction"]

# Stamps this close are one instant: 8.05 and 0.05 x 161 are not equal, and no velocity is seen between them.
_SAME_INSTANT_S = 1e-9
_NO_SUM = MotionSum()
_UNIT = np.eye(3)
# A step whose variance is as large did not measure: no test sees it, and sums of smaller ones stay exact [m^2, rad^2].
_UNMEASURED = 1e3


class Prediction:
    """Predicts a filter state to a later stamp.

    Motion adds its own covariance and nothing else: at standstill the belief grows as little as the localizer says.
    How base moves where nothing, or not everything, was measured, and how uncertain that is, says `Gaps`.

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
        self._is_independent = config.motions == "independent"
        self._uses_standstill = config.standstill == "use"
        self._common = CommonErrors(layout, kalman, self._is_independent)
        self._velocity = VelocityModel(layout, kalman, config.coast_s) if layout.has_velocity else None
        self._gaps = Gaps(config, self._velocity)
        self._tolerance = Tolerance.of(config)
        self._start_lasts_s = config.coast_s
        #: First instant that was heard of; the start state holds there, and for ``coast_s`` more [s].
        self.begun_s = math.inf

    @property
    def calibrated(self) -> Collection[str]:
        """The localizers whose common errors are a part of the state."""
        return self._layout.common.keys()

    def predict(self, state: FilterState, stamp_s: float) -> FilterState:
        """Return the state at a stamp that is not earlier."""
        if stamp_s <= state.stamp_s:
            return state
        if state.stamp_s == -math.inf:
            state = replace(state, stamp_s=min(stamp_s, self.begun_s + self._start_lasts_s))
        for cut_s in self._motions.cuts(state.stamp_s, stamp_s):
            state = self.predict_piece(state, cut_s)
        return self.predict_piece(state, stamp_s)

    def cuts(self, since_s: float, stamp_s: float) -> list[float]:
        """Return the stamps strictly inside an interval at which a motion begins or ends, in order."""
        return self._motions.cuts(since_s, stamp_s)

    def take_changed_since_s(self) -> float:
        """Return since when motion has changed after the last such question; ``inf`` if nothing was told [s]."""
        return self._motions.take_changed_since_s()

    def restart_after_gap(self, state: FilterState, gap_s: float, stamp_s: float) -> FilterState:
        """Return a state that starts anew at a stamp of another clock, as uncertain as after a gap."""
        at_rest = replace(state.odometry, gap_s=0.0, twist=AT_REST, unmeasured_s=NOWHERE)
        ahead = self._coast(replace(state, stamp_s=0.0, odometry=at_rest), gap_s)
        later_s = stamp_s - state.stamp_s
        moved = ahead.rejections.moved and on_another_clock(ahead.rejections.moved, later_s)
        rejections = replace(ahead.rejections, corroborations={}, measurements={}, moved=moved)
        odometry = replace(ahead.odometry, gap_s=0.0, unmeasured_s=NOWHERE)
        # by another clock no window goes on, nor a question: the belief covers its answers
        diagnosis = without_windows(ahead.diagnosis).on_another_clock(later_s)
        diagnosis = diagnosis._replace(tested_s=-math.inf, trials={})
        after = replace(ahead, stamp_s=-math.inf, odometry=odometry, rejections=rejections, diagnosis=diagnosis)
        return without_window(after)

    def predict_piece(self, state: FilterState, stamp_s: float) -> FilterState:
        """Predict over a piece of time in which no motion begins or ends."""
        if stamp_s - state.stamp_s < _SAME_INSTANT_S:
            return replace(state, stamp_s=stamp_s, verdicts=())
        stated = self._motions.steps(state.stamp_s, stamp_s)
        if not stated:
            return self._coast(state, stamp_s)
        diagnosis = state.diagnosis
        dt_s, theta = stamp_s - state.stamp_s, state.odometry.pose_odom_base.theta
        believed = stated
        if diagnosis.faults:
            believed = [one for one in stated if one[0] not in diagnosis.faults] or [
                (source, make_rough(step, dt_s)) for source, step in stated if diagnosis.faults[source].is_rough
            ]
            if not believed:
                return self._coast(state.with_diagnosis(_added(diagnosis, stated, theta, dt_s)), stamp_s)
        if diagnosis.doubts:
            believed = with_doubts(believed, diagnosis.doubts, dt_s)
        if len(believed) == 1:
            if state.odometry.is_measured and self._gate_of(believed[0][0]) is not None:
                selection = replace_impossible_jump(believed, dt_s, state.odometry.twist)
            else:
                selection = StepSelection(believed)
        else:
            drift = self._gaps.drift_of_step(dt_s)
            selection = select_steps(believed, dt_s, state.odometry.twist, drift, self._gate_of)
            if selection.left_out and not state.left_out:
                stated = _without_outliers(stated, selection)
        diagnosis = _added(diagnosis, stated, theta, dt_s)
        if self._layout.common and state.gaussian is not None:
            before = state.gaussian
            state = state.with_diagnosis(diagnosis)
            return self._with_common_errors(state, before, stamp_s, selection)
        steps = [step for _, step in selection.steps]
        doubted = [step for source, step in stated if source in diagnosis.faults] if diagnosis.faults else ()
        return self._apply_steps(state, stamp_s, selection, steps, None, diagnosis, doubted=doubted)

    def _with_common_errors(
        self, state: FilterState, before: Gaussian, stamp_s: float, selection: StepSelection
    ) -> FilterState:
        dt_s = stamp_s - state.stamp_s
        drift, held = self._gaps.drift_over(dt_s), state.odometry.twist
        stated = selection.steps
        if self._uses_standstill and stands(state, self._layout):
            stated = with_standstill(stated, dt_s)
        x, covariance = self._common.learn(before.x, before.covariance, stated, dt_s, held, drift)
        state = replace(state, gaussian=Gaussian(x, covariance, before.lasting))
        steps = self._common.remove_from(x, stated, dt_s)
        columns = self._common.jacobian(x, stated, dt_s, drift)
        return self._apply_steps(state, stamp_s, selection, steps, columns)

    def _apply_steps(
        self,
        state: FilterState,
        stamp_s: float,
        selection: StepSelection,
        steps: Sequence[MotionStep],
        columns: Floats | None,
        diagnosis: FaultDiagnosis | None = None,
        *,
        doubted: Sequence[MotionStep] = (),
    ) -> FilterState:
        dt_s, offsets = stamp_s - state.stamp_s, state.odometry.offsets
        if offsets:
            steps = with_offsets(selection.steps, steps, offsets)
        held = self._gaps.guess(state.odometry, doubted, dt_s) if doubted else state.odometry.twist
        step, is_measured = fuse_steps(steps, dt_s, held, self._gaps.drift_over(dt_s), self._is_independent)
        if offsets:
            step = with_lasting_error(step, selection.steps, offsets, dt_s, self._tolerance)
        piece = Piece(step, dt_s, 0.0, is_measured, columns)
        if not is_measured:
            piece = self._gaps.with_lasting_error(piece, state.odometry, dt_s)
        if len(steps) > 1 or offsets:
            offsets = offsets_after(selection.steps, step, offsets)
        moved = self._move(state, stamp_s, piece, diagnosis, offsets)
        if self._velocity is not None and moved.gaussian is not None:
            moved = self._velocity.update(moved, steps, dt_s, columns)
        if not (selection.checks or selection.left_out or state.left_out or state.checks):
            return moved
        left_out = {source: state.left_out.get(source, 0) + 1 for source in selection.left_out}
        return moved.with_checks(left_out, selection.checks)

    def _coast(self, state: FilterState, stamp_s: float) -> FilterState:
        """Predict over a piece of time in which nothing measured motion."""
        moved = self._move(state, stamp_s, self._gaps.coast(state, stamp_s))
        return moved if self._velocity is None or moved.gaussian is None else self._velocity.with_twist(moved)

    def _move(
        self,
        state: FilterState,
        stamp_s: float,
        piece: Piece,
        diagnosis: FaultDiagnosis | None = None,
        offsets: Mapping[str, Offset] = NO_OFFSETS,
    ) -> FilterState:
        before, step, odometry = state.gaussian, piece.step, state.odometry
        gaussian = None
        if before is not None:
            dt_s = stamp_s - state.stamp_s
            motion, way, heading = self._motion_of(before.x, step, dt_s, piece.columns, piece.velocity_held_s)
            lasting = carry_columns(before.lasting, way, heading, step.turn, dt_s)
            gaussian = Gaussian(*self._filter.predict(before.x, before.covariance, motion), lasting)
        twist = step.twist
        speed_mps = math.hypot(twist.forward_mps, twist.left_mps)
        moved = OdometryState(  # by place: names take a third of the time more
            odometry.pose_odom_base @ Pose2(step.x, step.y, step.turn),
            odometry.travelled_m + speed_mps * piece.driven_s,
            twist,
            piece.gap_s,
            piece.is_measured,
            odometry.has_moved or piece.gap_s == 0.0,
            piece.unmeasured_s,
            speed_mps if piece.is_measured else odometry.measured_mps,
            offsets,
        )
        return FilterState(stamp_s, gaussian, moved, state.fixed_at_m, state.rejections, diagnosis or state.diagnosis)

    def _motion_of(
        self, x: Floats, step: MotionStep, dt_s: float, columns: Floats | None, held_s: float
    ) -> tuple[PredictedMotion, tuple[float, float], tuple[float, float]]:
        """Return a step as the filters need it, its way in the map [m], and cosine and sine of the heading before."""
        numbers = x.tolist()
        px, py, theta = numbers[:3]
        cos, sin = math.cos(theta), math.sin(theta)
        dx, dy = cos * step.x - sin * step.y, sin * step.x + cos * step.y
        assert step.covariance is not None
        moved = np.array([px + dx, py + dy, wrap_angle(theta + step.turn), *numbers[3:]])
        jacobian = _UNIT.copy()  # numpy takes more than twice as long over nested lists
        jacobian[0, 2], jacobian[1, 2] = -dy, dx
        noise = frozen_matrix(congruence(step.covariance, cos, sin, 0.0, 0.0))
        if len(numbers) == 3:
            return PredictedMotion(moved, jacobian, noise, (step.x, step.y, step.turn)), (dx, dy), (cos, sin)
        turned = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        whole, spread = np.eye(len(x)), np.zeros((len(x), len(x)))
        whole[:3, :3], spread[:3, :3] = jacobian, noise
        if columns is not None:
            whole[:3] += turned @ columns
        if self._velocity is not None:
            self._velocity.carry(moved, whole, spread, turned, dt_s, held_s)
        self._common.wander(spread, dt_s)
        return PredictedMotion(moved, whole, spread, (step.x, step.y, step.turn)), (dx, dy), (cos, sin)


def _added(
    diagnosis: FaultDiagnosis, stated: Sequence[tuple[str, MotionStep]], theta: float, dt_s: float
) -> FaultDiagnosis:
    """Return sums to which the steps of all localizers are added, believed or not."""
    cos, sin = math.cos(theta), math.sin(theta)
    sums = dict(diagnosis.sums)
    for source, step in stated:
        position_m2, turn_rad2 = step.variances()
        x, y, turn, position_sum_m2, turn_sum_rad2, covered_s, open_ways, open_turns = sums.get(source) or _NO_SUM
        has_way, has_turn = position_m2 < _UNMEASURED, turn_rad2 < _UNMEASURED
        sums[source] = MotionSum(
            x + cos * step.x - sin * step.y,
            y + sin * step.x + cos * step.y,
            turn + step.turn,
            position_sum_m2 + position_m2 if has_way else position_sum_m2,
            turn_sum_rad2 + turn_rad2 if has_turn else turn_sum_rad2,
            covered_s + dt_s,
            open_ways + (not has_way),
            open_turns + (not has_turn),
        )
    return FaultDiagnosis(sums, *diagnosis[1:])  # a fifth of the time of _replace


def _without_outliers(
    stated: Sequence[tuple[str, MotionStep]], selection: StepSelection
) -> list[tuple[str, MotionStep]]:
    """Return the steps, with that of others in place of one that was left out: a single outlier has had its effect."""
    instead = selection.steps[0][1]
    return [(source, instead if source in selection.left_out else step) for source, step in stated]
