"""Who has lied is believed again when it has agreed again for long enough."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from trailmark.estimation.kalman.agreement import Tolerance, agreeing_groups, is_still, motion_since
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.kalman.windows import WINDOW_S, without_windows
from trailmark.geometry import wrap_angle

__all__ = ["AGREED", "GIVES_IN_S", "agree_again", "with_repentant", "without_fault"]

#: Absolute estimates that agree in a row end their fault; without them it ends after a time, and a lone liar wins [s].
AGREED, GIVES_IN_S = 3, 30.0


def without_fault(state: FilterState, source: str) -> FilterState:
    """Return a state that believes the absolute estimates of a localizer again."""
    faults = {other: fault for other, fault in state.consistency.absolute_faults.items() if other != source}
    counts = {**state.rejections.counts, source: 0}
    return replace(
        state,
        consistency=without_windows(state.consistency)._replace(absolute_faults=faults),
        rejections=replace(state.rejections, counts=counts),
    )


def with_repentant(state: FilterState, tolerance: Tolerance) -> FilterState:
    """Return a state that believes again who has agreed with the others over a window in which the robot moved."""
    faults = dict(state.consistency.faults)
    for source, fault in state.consistency.faults.items():
        anchors = [anchor for anchor in state.consistency.anchors if anchor.stamp_s >= fault.since_s]
        if not anchors or state.stamp_s - anchors[0].stamp_s < WINDOW_S:
            continue
        trusted = [s for s in state.consistency.sums if s not in state.consistency.faults]
        agrees = (
            agree_again(state, anchors[0], [source, *trusted], tolerance)
            if trusted
            else _agrees_with_corrections(state, anchors[0], source)
        )
        if agrees:
            del faults[source]
    if len(faults) == len(state.consistency.faults):
        return state
    return replace(state, consistency=state.consistency._replace(faults=faults, anchors=(), measurements=()))


def agree_again(state: FilterState, anchor: FilterState, sources: Sequence[str], tolerance: Tolerance) -> bool:
    """Return whether localizers, all of them moving, have agreed since an anchor."""
    motions = [motion for source in sources if (motion := motion_since(state, anchor, source)) is not None]
    dt_s = state.stamp_s - anchor.stamp_s - 1e-6
    if len(motions) < len(sources) or any(is_still(motion) or motion.covered_s < dt_s for motion in motions):
        return False
    return len(agreeing_groups(state, anchor, sources, tolerance)) == 1


def _agrees_with_corrections(state: FilterState, anchor: FilterState, source: str) -> bool:
    """Return whether a motion is as long, and turns as far, as the belief has moved by absolute estimates alone."""
    motion = motion_since(state, anchor, source)
    covered_s = 0.0 if motion is None else motion.covered_s
    if covered_s < state.stamp_s - anchor.stamp_s - 1e-6:
        return False
    if motion is None or state.gaussian is None or anchor.gaussian is None or is_still(motion):
        return False
    moved = state.gaussian.x[:3] - anchor.gaussian.x[:3]
    spread = (state.gaussian.covariance + anchor.gaussian.covariance)[:3, :3].diagonal()
    sigma_m = math.sqrt(max(spread[0], spread[1]) + motion.position_m2)
    way_m, says_m = math.hypot(moved[0], moved[1]), math.hypot(motion.x, motion.y)
    turn = abs(wrap_angle(float(moved[2]) - motion.turn))
    is_informative = way_m > 5.0 * sigma_m
    return (
        is_informative and abs(way_m - says_m) < 2.5 * sigma_m and turn < 2.5 * math.sqrt(spread[2] + motion.turn_rad2)
    )
