"""Whether localizers agree, from their motion over a window and from what absolute estimates had to correct.

Noise averages out over a window, an error that persists does not: the steps of two localizers, added up since an
anchor one to two seconds ago, are compared with the variances that they state (a chi-square test of the accumulated
parity vector; Willsky, "A survey of design methods for failure detection in dynamic systems", Automatica 12, 1976). Two
honest odometries differ by their calibration, too: this is allowed for.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations

from trailmark.estimation.kalman.diagnosis import MotionSum
from trailmark.estimation.kalman.gate import threshold
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.geometry import wrap_angle
from trailmark.values import new_tuple

__all__ = [
    "ACQUITTED",
    "Tolerance",
    "agreeing_groups",
    "corrections_are_consistent",
    "disagreement_within",
    "is_still",
    "motion_since",
    "pair_nis",
    "whole_motions",
]

# One false alarm in some hours, with a test a second.
_PROBABILITY = 0.99999
#: With which a motion that is honest agrees, where it is asked whether one that was not does so again.
ACQUITTED = 0.95
# A variance below this says that nothing was corrected [m^2, rad^2].
_UNCORRECTED = 1e-12
# No variance is less: sums of some differ by nothing in their last digit [m^2, rad^2].
_LEAST = 1e-15


@dataclass(frozen=True, slots=True)
class Tolerance:
    """By how much honest localizers differ in their calibration, as standard deviations.

    Attributes
    ----------
    scale : float
        Share of the way, and of the turn.
    yaw_radps : float
        Yaw rate of a robot that does not turn [rad/s].
    late_s : float
        By how much their stamps are off against each other: it shows where the velocity changes [s].
    """

    scale: float
    yaw_radps: float
    late_s: float = 0.0

    @classmethod
    def of(cls, config: KalmanConfig) -> Tolerance:
        """Return what a config says of it."""
        return cls(config.agree_scale, math.radians(config.agree_deg_per_s), config.agree_late_s)


def motion_since(state: FilterState, anchor: FilterState, source: str) -> MotionSum | None:
    """Return what a localizer says of the motion since an anchor; None if it said nothing then or since.

    A variance is ``inf`` where a step since then did not measure.
    """
    now, then = state.diagnosis.sums.get(source), anchor.diagnosis.sums.get(source)
    if now is None or then is None or now is then:
        return None
    x, y, turn, position_m2, turn_rad2, covered_s, open_ways, open_turns = now
    then_x, then_y, then_turn, then_m2, then_rad2, then_s, then_ways, then_turns = then
    open_ways, open_turns = open_ways - then_ways, open_turns - then_turns
    position_m2 = math.inf if open_ways else max(position_m2 - then_m2, 0.0)
    turn_rad2 = math.inf if open_turns else max(turn_rad2 - then_rad2, 0.0)
    way = x - then_x, y - then_y, turn - then_turn, position_m2, turn_rad2, covered_s - then_s, open_ways, open_turns
    return new_tuple(MotionSum, way)


def velocity_change(state: FilterState, anchor: FilterState) -> tuple[float, float]:
    """Return by how much the velocity and the yaw rate have changed since an anchor [m/s, rad/s].

    Stamps that are late by a time make a motion over a window differ by that time times this: what it tells of the
    beginning of the window is older, and so is what it tells of the end.
    """
    (x, y, yaw_radps), (then_x, then_y, then_radps) = (_velocity_in_odom(one) for one in (state, anchor))
    return math.hypot(x - then_x, y - then_y), abs(yaw_radps - then_radps)


def _velocity_in_odom(state: FilterState) -> tuple[float, float, float]:
    twist, theta = state.odometry.twist, state.odometry.pose_odom_base.theta
    cos, sin = math.cos(theta), math.sin(theta)
    x_mps, y_mps = cos * twist.forward_mps - sin * twist.left_mps, sin * twist.forward_mps + cos * twist.left_mps
    return x_mps, y_mps, twist.yaw_radps


def pair_nis(
    a: MotionSum,
    b: MotionSum,
    tolerance: Tolerance,
    *,
    way_m: float,
    dt_s: float,
    change: tuple[float, float] = (0.0, 0.0),
) -> tuple[float, int]:
    """Return NIS and degrees of freedom of the difference of two motions over the same window."""
    late_m, late_rad = (tolerance.late_s * one for one in change)
    position_m2 = a.position_m2 + b.position_m2 + late_m**2 + _LEAST
    turn_rad2 = a.turn_rad2 + b.turn_rad2 + late_rad**2 + _LEAST
    nis, dof = 0.0, 0
    if position_m2 < math.inf:
        position_m2 += (tolerance.scale * way_m) ** 2
        nis, dof = ((a.x - b.x) ** 2 + (a.y - b.y) ** 2) / position_m2, 2
    if turn_rad2 < math.inf:
        turn = min(abs(a.turn), abs(b.turn))
        turn_rad2 += (tolerance.scale * turn) ** 2 + (tolerance.yaw_radps * dt_s) ** 2
        nis, dof = nis + (a.turn - b.turn) ** 2 / turn_rad2, dof + 1
    return nis, dof


def agreeing_groups(
    state: FilterState,
    anchor: FilterState,
    sources: Iterable[str],
    tolerance: Tolerance,
    *,
    probability: float = _PROBABILITY,
) -> list[frozenset[str]]:
    """Return the largest groups of localizers in which each agrees with every other over the window.

    One that is noisy may be in several: wheels agree with a camera and with a laser that contradict each other.
    Whom nothing tests is in all.
    """
    everyone, dt_s = frozenset(sources), state.stamp_s - anchor.stamp_s
    change = velocity_change(state, anchor)
    tested = whole_motions(state, anchor, sources)
    if len(tested) < 2:
        return [everyone]
    apart = {
        frozenset((a, b))
        for (a, one), (b, other) in combinations(tested.items(), 2)
        if not _agree(one, other, tolerance, dt_s, change, probability)
    }
    if not apart:
        return [everyone]
    groups: list[frozenset[str]] = []
    for size in range(len(tested), 0, -1):
        for names in combinations(tested, size):
            group = frozenset(names)
            if not any(pair <= group for pair in apart) and not any(group < larger for larger in groups):
                groups.append(group)
    return [group | (everyone - tested.keys()) for group in groups]


def whole_motions(state: FilterState, anchor: FilterState, sources: Iterable[str]) -> dict[str, MotionSum]:
    """Return what localizers say of the motion since an anchor, of those that tell of all of it."""
    motions = {source: motion_since(state, anchor, source) for source in sources}
    least_s = state.stamp_s - anchor.stamp_s - 1e-6
    return {source: motion for source, motion in motions.items() if motion is not None and motion.covered_s > least_s}


def disagreement_within(state: FilterState, anchor: FilterState, sources: Iterable[str], tolerance: Tolerance) -> float:
    """Return by how much localizers of one group differ over a window: NIS, as from their mean were they alike."""
    motions = whole_motions(state, anchor, sources).values()
    dt_s, change = state.stamp_s - anchor.stamp_s, velocity_change(state, anchor)
    pairs = [_nis_of(a, b, tolerance, dt_s, change)[0] for a, b in combinations(motions, 2)]
    return 2.0 / len(motions) * sum(pairs) if pairs else 0.0


def _agree(
    a: MotionSum, b: MotionSum, tolerance: Tolerance, dt_s: float, change: tuple[float, float], probability: float
) -> bool:
    nis, dof = _nis_of(a, b, tolerance, dt_s, change)
    return dof == 0 or nis <= threshold(probability, dof)


def _nis_of(
    a: MotionSum, b: MotionSum, tolerance: Tolerance, dt_s: float, change: tuple[float, float]
) -> tuple[float, int]:
    # The way of the slower one: a robot is not thought to have gone far because one of two says so.
    way_m = min(math.hypot(a.x, a.y), math.hypot(b.x, b.y))
    return pair_nis(a, b, tolerance, way_m=way_m, dt_s=dt_s, change=change)


def corrections_are_consistent(state: FilterState, anchor: FilterState) -> bool:
    """Return whether the corrections since an anchor are as large as their covariance says.

    The corrections of a consistent filter are white: one that is always corrected the same way moves by a wrong motion.
    """
    now, then = state.diagnosis, anchor.diagnosis
    x, y, turn = (now.corrections - then.corrections).tolist()
    variances = (now.correction_covariance.diagonal() - then.correction_covariance.diagonal()).tolist()
    limit = threshold(_PROBABILITY, 1)
    moved = x, y, wrap_angle(turn)
    return all(away**2 / variance <= limit for away, variance in zip(moved, variances) if variance > _UNCORRECTED)


def is_still(motion: MotionSum) -> bool:
    """Return whether a localizer says that base stood still."""
    return bool(math.hypot(motion.x, motion.y) <= 3.0 * math.sqrt(motion.position_m2)) and (
        abs(motion.turn) <= 3.0 * math.sqrt(motion.turn_rad2)
    )
