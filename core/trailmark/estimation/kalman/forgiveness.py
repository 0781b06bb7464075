"""Who has lied is believed again when it has agreed again for long enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from trailmark.estimation.kalman.agreement import Tolerance, agreeing_groups, is_still, motion_since
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.kalman.trials import acquitted
from trailmark.estimation.kalman.windows import WINDOW_S, without_windows

__all__ = ["AGREED", "GIVES_IN_S", "agree_again", "with_repentant", "without_fault"]

#: Absolute estimates that agree in a row end their fault; without them it ends after a time, and a lone liar wins [s].
AGREED, GIVES_IN_S = 3, 30.0


def without_fault(state: FilterState, source: str) -> FilterState:
    """Return a state that believes the absolute estimates of a localizer again."""
    faults = {other: fault for other, fault in state.diagnosis.absolute_faults.items() if other != source}
    counts = {**state.rejections.counts, source: 0}
    return replace(
        state,
        diagnosis=without_windows(state.diagnosis)._replace(absolute_faults=faults),
        rejections=replace(state.rejections, counts=counts),
    )


def with_repentant(state: FilterState, tolerance: Tolerance) -> FilterState:
    """Return a state that believes again who has agreed with the others over a window in which the robot moved.

    Where no motion is believed, the absolute estimates say it: see `trials`.
    """
    trusted = [s for s in state.diagnosis.sums if s not in state.diagnosis.faults]
    repentant = (
        [source for source in state.diagnosis.faults if _has_agreed_again(state, source, trusted, tolerance)]
        if trusted
        else acquitted(state)
    )
    if not repentant:
        return state
    faults = {source: fault for source, fault in state.diagnosis.faults.items() if source not in repentant}
    return replace(state, diagnosis=state.diagnosis._replace(faults=faults, anchors=(), measurements=(), trials={}))


def _has_agreed_again(state: FilterState, source: str, trusted: Sequence[str], tolerance: Tolerance) -> bool:
    since_s = state.diagnosis.faults[source].since_s
    anchors = [anchor for anchor in state.diagnosis.anchors if anchor.stamp_s >= since_s]
    if not anchors or state.stamp_s - anchors[0].stamp_s < WINDOW_S:
        return False
    return agree_again(state, anchors[0], [source, *trusted], tolerance)


def agree_again(state: FilterState, anchor: FilterState, sources: Sequence[str], tolerance: Tolerance) -> bool:
    """Return whether localizers, all of them moving, have agreed since an anchor."""
    motions = [motion for source in sources if (motion := motion_since(state, anchor, source)) is not None]
    dt_s = state.stamp_s - anchor.stamp_s - 1e-6
    if len(motions) < len(sources) or any(is_still(motion) or motion.covered_s < dt_s for motion in motions):
        return False
    return len(agreeing_groups(state, anchor, sources, tolerance)) == 1
