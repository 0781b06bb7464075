"""Carrying the filter on in time: with the motion that was measured, or with the last velocity."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from operator import is_

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.agreement import Tolerance
from trailmark.estimation.kalman.common_errors import CommonErrors
from trailmark.estimation.kalman.correction import Filter
from trailmark.estimation.kalman.diagnosis import MotionSum
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
from trailmark.estimation.kalman.state import NOTHING, FilterState, Gaussian, MotionCheck, OdometryState
from trailmark.estimation.kalman.velocity import VelocityModel
from trailmark.estimation.kalman.weighing import (
    SourceStep,
    StepSelection,
    fuse_steps,
    replace_impossible_jump,
    select_steps,
    without_outliers,
)
from trailmark.estimation.kalman.windows import without_windows
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.symmetric import frozen_matrix, turned
from trailmark.estimation.unmeasured import NOWHERE
from trailmark.geometry import Pose2, Twist2, wrap_angle
from trailmark.values import new_tuple, quick_dataclass

__all__ = ["Prediction"]

# Stamps this close are one instant: 8.05 and 0.05 x 161 are not equal, and no velocity is seen between them.
_SAME_INSTANT_S = 1e-9
_NO_SUM = MotionSum()
_NO_SELECTION = StepSelection(())
# Ways that are kept: the instants that a late fix redoes.
_N_WAYS = 1024
_UNIT = np.eye(3)
# A step whose variance is as large did not measure: no test sees it, and sums of smaller ones stay exact [m^2, rad^2].
_UNMEASURED = 1e3


@quick_dataclass(frozen=True, slots=True, eq=False)
class _Way:
    """What motion says of a piece of time, wherever base is in the map: a late fix asks for it again.

    Attributes
    ----------
    begun_s : float
        Where the piece begins [s].
    known : tuple
        What was known there, as in `FilterState`: sums, faults, doubts and steps left out. Not the state itself, whose
        diagnosis would keep older ones alive.
    told : sequence of (str, MotionStep)
        What the localizers say of it.
    stamp_s, dt_s : float
        Its end, and its length [s].
    piece : Piece
        How base moves in it.
    odometry, sums, left_out, checks
        At its end, as in `FilterState`.
    steps : sequence of MotionStep
        Those that count.
    """

    begun_s: float
    known: tuple[object, ...]
    told: Sequence[SourceStep]
    stamp_s: float
    dt_s: float
    piece: Piece
    odometry: OdometryState
    sums: Mapping[str, MotionSum]
    left_out: Mapping[str, int]
    checks: tuple[MotionCheck, ...]
    steps: Sequence[MotionStep]

    def is_known_of(self, state: FilterState, stamp_s: float, told: Sequence[SourceStep]) -> bool:
        """Return whether another state of the same odometry goes the same way."""
        return (
            self.stamp_s == stamp_s
            and self.begun_s == state.stamp_s
            and all(map(is_, self.known, _known_of(state)))
            and self.told == told
        )


def _known_of(state: FilterState) -> tuple[object, ...]:
    diagnosis = state.diagnosis
    return diagnosis.sums, diagnosis.faults, diagnosis.doubts, state.left_out


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
        self._ways: OrderedDict[OdometryState, _Way] = OrderedDict()
        self._asks_state = self._velocity is not None or bool(layout.common)  # its ways are no others' then
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
        begun = replace(state, stamp_s=0.0, odometry=at_rest)
        ahead = self._moved(begun, self._way_of(begun, gap_s, self._gaps.coast(begun, gap_s), (), begun.diagnosis.sums))
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
        way = self._ways.get(state.odometry)
        if way is None or not way.is_known_of(state, stamp_s, stated):
            state, way = self._new_way(state, stamp_s, stated)
            if not self._asks_state:
                self._ways[state.odometry] = way
                if len(self._ways) > _N_WAYS:
                    self._ways.popitem(last=False)
        return self._moved(state, way)

    def _moved(self, state: FilterState, way: _Way) -> FilterState:
        """Return a state at the end of a way that begins there."""
        before, gaussian, diagnosis = state.gaussian, None, state.diagnosis
        if before is not None:
            motion, direction, heading = self._motion_of(before.x, way.piece, way.dt_s)
            lasting = carry_columns(before.lasting, direction, heading, way.piece.step.turn, way.dt_s)
            gaussian = Gaussian(*self._filter.predict(before.x, before.covariance, motion), lasting)
        moved = FilterState(  # by place: names take a third of the time more
            way.stamp_s,
            gaussian,
            way.odometry,
            state.fixed_at_m,
            state.rejections,
            diagnosis if way.sums is diagnosis.sums else diagnosis.with_sums(way.sums),
            way.left_out,
            way.checks,
        )
        if self._velocity is None or gaussian is None:
            return moved
        if way.steps:
            return self._velocity.update(moved, way.steps, way.dt_s, way.piece.columns)
        return self._velocity.with_twist(moved)

    def _new_way(self, state: FilterState, stamp_s: float, stated: Sequence[SourceStep]) -> tuple[FilterState, _Way]:
        """Return a state, corrected by what the steps say of each other's common errors, and the way from it on."""
        dt_s, diagnosis, told = stamp_s - state.stamp_s, state.diagnosis, stated
        faults = diagnosis.faults
        believed = stated
        if faults and stated:
            believed = [one for one in stated if one[0] not in faults] or [
                (source, make_rough(step, dt_s)) for source, step in stated if faults[source].is_rough
            ]
        if not believed:
            piece, sums = self._gaps.coast(state, stamp_s), _added(state, stated, dt_s)
            return state, self._way_of(state, stamp_s, piece, told, sums)
        if diagnosis.doubts:
            believed = with_doubts(believed, diagnosis.doubts, dt_s)
        held = state.odometry.twist
        if len(believed) > 1:
            selection = select_steps(believed, dt_s, held, self._gaps.drift_of_step(dt_s), self._gate_of)
            if selection.left_out:
                stated = without_outliers(stated, selection, self._left_out_since(state, stamp_s, selection))
        elif state.odometry.is_measured and self._gate_of(believed[0][0]) is not None:
            selection = replace_impossible_jump(believed, dt_s, held)
        else:
            selection = StepSelection(believed)
        sums = _added(state, stated, dt_s)
        steps: Sequence[MotionStep] = [step for _, step in selection.steps]
        columns = None
        if self._layout.common and state.gaussian is not None:
            state, steps, columns = self._with_common_errors(state, state.gaussian, selection, dt_s)
        elif faults:
            held = self._gaps.guess(state.odometry, [step for source, step in stated if source in faults], dt_s)
        if state.odometry.offsets:
            steps = with_offsets(selection.steps, steps, state.odometry.offsets)
        piece, offsets = self._piece(state.odometry, selection.steps, steps, columns, dt_s, held)
        return state, self._way_of(state, stamp_s, piece, told, sums, selection, steps, offsets)

    def _with_common_errors(
        self, state: FilterState, before: Gaussian, selection: StepSelection, dt_s: float
    ) -> tuple[FilterState, Sequence[MotionStep], Floats]:
        """Return a state that has learned of common errors, the steps without them, and how these change with it."""
        drift, stated = self._gaps.drift_over(dt_s), selection.steps
        if self._uses_standstill and stands(state, self._layout):
            stated = with_standstill(stated, dt_s)
        x, covariance = self._common.learn(before.x, before.covariance, stated, dt_s, state.odometry.twist, drift)
        state = replace(state, gaussian=Gaussian(x, covariance, before.lasting))
        return state, self._common.remove_from(x, stated, dt_s), self._common.jacobian(x, stated, dt_s, drift)

    def _piece(
        self,
        odometry: OdometryState,
        stated: Sequence[SourceStep],
        steps: Sequence[MotionStep],
        columns: Floats | None,
        dt_s: float,
        held: Twist2,
    ) -> tuple[Piece, Mapping[str, Offset]]:
        """Return the piece of time that steps make together, and where matches have led base after it."""
        offsets, drift = odometry.offsets, self._gaps.drift_over(dt_s)
        step, is_measured = fuse_steps(steps, dt_s, held, drift, self._is_independent)
        if offsets:
            step = with_lasting_error(step, stated, offsets, dt_s, self._tolerance)
        piece = Piece(step, dt_s, 0.0, is_measured, columns)
        if not is_measured:
            piece = self._gaps.with_lasting_error(piece, odometry, dt_s)
        if len(steps) > 1 or offsets:
            offsets = offsets_after(stated, step, offsets)
        return piece, offsets

    def _way_of(
        self,
        state: FilterState,
        stamp_s: float,
        piece: Piece,
        told: Sequence[SourceStep],
        sums: Mapping[str, MotionSum],
        selection: StepSelection = _NO_SELECTION,
        steps: Sequence[MotionStep] = (),
        offsets: Mapping[str, Offset] = NO_OFFSETS,
    ) -> _Way:
        """Return where a piece of time leads."""
        step, odometry, twist = piece.step, state.odometry, piece.step.twist
        speed_mps = math.hypot(twist.forward_mps, twist.left_mps)
        moved = OdometryState(
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
        left_out = self._left_out_since(state, stamp_s, selection)
        dt_s = stamp_s - state.stamp_s
        return _Way(
            state.stamp_s, _known_of(state), told, stamp_s, dt_s, piece, moved, sums, left_out, selection.checks, steps
        )

    def _left_out_since(self, state: FilterState, stamp_s: float, selection: StepSelection) -> Mapping[str, int]:
        """Return whose steps are left out, and in how many of its motions in a row.

        One motion is cut where those of others begin and end, and is one outlier all the same.
        """
        if not selection.left_out:
            return NOTHING
        before, begins = state.left_out, self._motions.begins
        return {
            source: before[source] + begins(source, state.stamp_s, stamp_s) if source in before else 1
            for source in selection.left_out
        }

    def _motion_of(
        self, x: Floats, piece: Piece, dt_s: float
    ) -> tuple[PredictedMotion, tuple[float, float], tuple[float, float]]:
        """Return a piece as the filters need it, its way in the map [m], and cosine and sine of the heading before."""
        numbers, step = x.tolist(), piece.step
        px, py, theta = numbers[:3]
        cos, sin = math.cos(theta), math.sin(theta)
        dx, dy = cos * step.x - sin * step.y, sin * step.x + cos * step.y
        assert step.covariance is not None
        moved = np.array([px + dx, py + dy, wrap_angle(theta + step.turn), *numbers[3:]])
        jacobian = _UNIT.copy()  # numpy takes more than twice as long over nested lists
        jacobian[0, 2], jacobian[1, 2] = -dy, dx
        noise = frozen_matrix(turned(step.covariance, cos, sin))
        if len(numbers) == 3:
            return PredictedMotion(moved, jacobian, noise, (step.x, step.y, step.turn)), (dx, dy), (cos, sin)
        turning = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        whole, spread = np.eye(len(x)), np.zeros((len(x), len(x)))
        whole[:3, :3], spread[:3, :3] = jacobian, noise
        if piece.columns is not None:
            whole[:3] += turning @ piece.columns
        if self._velocity is not None:
            self._velocity.carry(moved, whole, spread, turning, dt_s, piece.velocity_held_s)
        self._common.wander(spread, dt_s)
        return PredictedMotion(moved, whole, spread, (step.x, step.y, step.turn)), (dx, dy), (cos, sin)


def _added(state: FilterState, stated: Sequence[SourceStep], dt_s: float) -> Mapping[str, MotionSum]:
    """Return sums to which the steps of all localizers are added, believed or not."""
    if not stated:
        return state.diagnosis.sums
    theta = state.odometry.pose_odom_base.theta
    cos, sin = math.cos(theta), math.sin(theta)
    sums = dict(state.diagnosis.sums)
    for source, step in stated:
        position_m2, turn_rad2 = step.variances()
        x, y, turn, position_sum_m2, turn_sum_rad2, covered_s, open_ways, open_turns = sums.get(source) or _NO_SUM
        has_way, has_turn = position_m2 < _UNMEASURED, turn_rad2 < _UNMEASURED
        sums[source] = new_tuple(
            MotionSum,
            (
                x + cos * step.x - sin * step.y,
                y + sin * step.x + cos * step.y,
                turn + step.turn,
                position_sum_m2 + position_m2 if has_way else position_sum_m2,
                turn_sum_rad2 + turn_rad2 if has_turn else turn_sum_rad2,
                covered_s + dt_s,
                open_ways + (not has_way),
                open_turns + (not has_turn),
            ),
        )
    return sums
