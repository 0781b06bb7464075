"""Whether base stands, by wheels that do not turn and a gyro that agrees: then its rate is its bias.

A zero-velocity update of the yaw rate: while base stands, a turn of nothing is told beside what localizers say. Wheels
that are stuck while something else moves must not be believed, so nobody may contradict: no other motion, no absolute
estimate.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from trailmark.estimation.kalman.agreement import corrections_are_consistent, is_still, motion_since
from trailmark.estimation.kalman.diagnosis import MotionSum
from trailmark.estimation.kalman.layout import CommonError, Layout
from trailmark.estimation.kalman.motions import MotionStep
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.symmetric import diagonal
from trailmark.geometry import Twist2

__all__ = ["STANDSTILL", "stands", "with_standstill"]

#: The name under which standing is told beside localizers.
STANDSTILL = "(standstill)"

# What wheels that stand still count, over a window of one to two seconds [m, rad].
_NO_WAY_M, _NO_TURN_RAD = 0.002, math.radians(0.05)
# The shortest look [s].
_WINDOW_S = 0.9
# A variance beyond this says that the turn was not measured [rad^2]. Wheels of recordings leave a few degrees open in
# the window; a speed sensor leaves all of it.
_TURN_NOT_MEASURED = math.radians(10.0) ** 2
# What standing leaves open of the turn: vibration, in 1 s and with the root of the time [rad].
_VIBRATION_RAD = math.radians(0.01)
_SIGMAS = 3.0


def stands(state: FilterState, layout: Layout) -> bool:
    """Return whether base has stood for about a second, by all that is known.

    Wheels (a localizer that measures way and turn) must say that nothing moved; a gyro whose bias is estimated must
    agree within what is known of the bias; nobody else may say that base moved, or be contradicting the belief.
    """
    diagnosis = state.diagnosis
    if state.gaussian is None or not diagnosis.anchors or diagnosis.rivals or diagnosis.alternatives:
        return False
    anchor = diagnosis.anchors[0]
    dt_s = state.stamp_s - anchor.stamp_s
    if dt_s < _WINDOW_S or any(state.rejections.counts.values()) or diagnosis.faults:
        return False
    told = {source: motion_since(state, anchor, source) for source in diagnosis.sums}
    motions = {source: motion for source, motion in told.items() if motion is not None}
    wheels = [source for source, motion in motions.items() if _does_not_turn(motion, dt_s)]
    if not wheels or not _gyros_agree(state, motions, layout.common):
        return False
    others = (motion for source, motion in motions.items() if source not in wheels and source not in layout.common)
    return all(is_still(motion) for motion in others) and corrections_are_consistent(state, anchor)


def with_standstill(steps: Sequence[tuple[str, MotionStep]], dt_s: float) -> list[tuple[str, MotionStep]]:
    """Return what is said of a piece of time, and beside it that base did not turn.

    Nothing is said of the way: a robot that is pushed on stuck wheels does not turn either, and a position that stands
    for certain would refuse the fixes that see it move.
    """
    no_turn = diagonal(0.0, 0.0, 1.0 / (_VIBRATION_RAD * _VIBRATION_RAD * dt_s))
    return [*steps, (STANDSTILL, MotionStep(0.0, 0.0, 0.0, None, no_turn, Twist2()))]


def _does_not_turn(motion: MotionSum, dt_s: float) -> bool:
    is_measured = motion.position_m2 < math.inf and motion.turn_rad2 < _TURN_NOT_MEASURED
    is_whole = is_measured and motion.covered_s > 0.9 * dt_s
    return is_whole and math.hypot(motion.x, motion.y) <= _NO_WAY_M and abs(motion.turn) <= _NO_TURN_RAD


def _gyros_agree(state: FilterState, motions: Mapping[str, MotionSum], common: Mapping[str, CommonError]) -> bool:
    """Return whether there is a gyro, and each turned by its bias alone, as far as that is known."""
    assert state.gaussian is not None
    gyros = {source: one for source, one in common.items() if one.kind == "gyro_bias" and source in motions}
    for source, one in gyros.items():
        motion = motions[source]
        bias, variance = float(state.gaussian.x[one.index]), float(state.gaussian.covariance[one.index, one.index])
        sigma = math.sqrt(motion.turn_rad2 + variance * motion.covered_s**2)
        if abs(motion.turn - bias * motion.covered_s) > _SIGMAS * sigma:
            return False
    return bool(gyros)
