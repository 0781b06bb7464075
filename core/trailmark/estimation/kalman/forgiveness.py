"""Who has lied is believed again when it has agreed again for long enough."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from trailmark.estimation.kalman.agreement import (
    ACQUITTED,
    Tolerance,
    agreeing_groups,
    is_still,
    motion_since,
)
from trailmark.estimation.kalman.diagnosis import DetectedFault
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.kalman.trials import acquitted
from trailmark.estimation.kalman.windows import APART_S, LONGEST_S, windows_since, without_windows

__all__ = ["AGREED", "GIVES_IN_S", "agree_again", "window_that_shows", "with_repentant", "without_fault"]

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
    """Return a state that believes again who has agreed with the others over a window in which its lie would show.

    Where no motion is believed, the absolute estimates say it: see `trials`.
    """
    trusted = [s for s in state.diagnosis.sums if s not in state.diagnosis.faults]
    faults = {
        source: replace(fault, shows_in_s=min(fault.shows_in_s, window_that_shows(state, source, trusted, tolerance)))
        for source, fault in state.diagnosis.faults.items()
    }
    repentant = (
        [source for source in faults if agree_again(state, [source, *trusted], tolerance, {source: faults[source]})]
        if trusted
        else acquitted(state)
    )
    if not repentant:
        return replace(state, diagnosis=state.diagnosis._replace(faults=faults))
    faults = {source: fault for source, fault in faults.items() if source not in repentant}
    diagnosis = state.diagnosis._replace(faults=faults, anchors=(), far_anchors=(), measurements=(), trials={})
    return replace(state, diagnosis=diagnosis)


def window_that_shows(state: FilterState, source: str, others: Iterable[str], tolerance: Tolerance) -> float:
    """Return over how short a window a motion disagrees with others; the longest there is if over none [s]."""
    for anchor in windows_since(state, -math.inf):
        if any(len(agreeing_groups(state, anchor, [source, other], tolerance)) > 1 for other in others):
            return state.stamp_s - anchor.stamp_s
    return LONGEST_S - APART_S


def agree_again(
    state: FilterState, sources: Sequence[str], tolerance: Tolerance, faults: Mapping[str, DetectedFault]
) -> bool:
    """Return whether localizers, all of them moving, have agreed for a window in which the lies would have shown.

    In no shorter one may they disagree: who says now too much of what it said too little of is no more honest.

    Parameters
    ----------
    state : FilterState
        Now.
    sources : sequence of str
        The localizers.
    tolerance : Tolerance
        By how much honest ones differ.
    faults : mapping of str to DetectedFault
        Of those of them that are accused.
    """
    since_s = max(fault.since_s for fault in faults.values())
    shows_in_s = max(fault.shows_in_s for fault in faults.values())
    for anchor in windows_since(state, since_s):
        if len(agreeing_groups(state, anchor, sources, tolerance)) > 1:
            return False  # over a longer window their ways may cross
        if state.stamp_s - anchor.stamp_s >= shows_in_s and _agree_since(state, anchor, sources, tolerance):
            return True
    return False


def _agree_since(state: FilterState, anchor: FilterState, sources: Sequence[str], tolerance: Tolerance) -> bool:
    motions = [motion for source in sources if (motion := motion_since(state, anchor, source)) is not None]
    dt_s = state.stamp_s - anchor.stamp_s - 1e-6
    if len(motions) < len(sources) or any(is_still(motion) or motion.covered_s < dt_s for motion in motions):
        return False
    return len(agreeing_groups(state, anchor, sources, tolerance, probability=ACQUITTED)) == 1
