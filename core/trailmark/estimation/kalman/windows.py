"""The windows over which localizers are compared: where they begin, and what was measured since."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from trailmark.estimation.kalman.diagnosis import FaultDiagnosis, LastingDoubt, Retrial
from trailmark.estimation.kalman.state import FilterState

__all__ = ["APART_S", "LONGEST_S", "WINDOW_S", "far_anchors_due", "windows_since", "with_new_anchor", "without_windows"]

#: The tests look back by one to two of these: long beside the period of any localizer, short beside what a robot can
#: do about a lie [s].
WINDOW_S = 1.0
#: A lie that grows slowly beside the noise of steps shows over longer windows only. They begin apart by so much; the
#: longest is bounded: the hypotheses of a question are predicted anew from its beginning [s].
APART_S, LONGEST_S = 2.0, 8.0
# Between two tests over the longer windows [s].
_EVERY_S = 0.5

_NO_TRIALS: Mapping[str, Retrial] = MappingProxyType({})
_NO_DOUBTS: Mapping[str, LastingDoubt] = MappingProxyType({})


def far_anchors_due(diagnosis: FaultDiagnosis, tested_s: float, stamp_s: float) -> Sequence[FilterState]:
    """Return where the longer test windows begin, the shortest first; none if they were tested just before."""
    if not diagnosis.anchors or stamp_s // _EVERY_S == tested_s // _EVERY_S:
        return ()
    since_s = diagnosis.anchors[0].stamp_s
    return [one for one in reversed(diagnosis.far_anchors) if one.stamp_s < since_s]


def windows_since(state: FilterState, since_s: float) -> list[FilterState]:
    """Return where test windows of a length that is enough begin, none of them before a stamp, the shortest first."""
    near = state.diagnosis.anchors[:1]
    anchors = {one.stamp_s: one for one in (*state.diagnosis.far_anchors, *near)}
    until_s = min([state.stamp_s - WINDOW_S, *(one.stamp_s for one in near)])
    return [anchors[at_s] for at_s in sorted(anchors, reverse=True) if since_s <= at_s <= until_s]


def with_new_anchor(state: FilterState) -> FilterState:
    """Return a state whose test windows begin later: the older anchor goes, and this instant is the newer one."""
    diagnosis = state.diagnosis
    bare = replace(
        state, diagnosis=without_windows(diagnosis)._replace(trials=_NO_TRIALS, doubts=_NO_DOUBTS), verdicts=()
    )
    anchors = (*diagnosis.anchors[-1:], bare)
    far_anchors = _with_far_anchor(state.stamp_s, diagnosis.far_anchors, bare)
    since_s = min(anchors[0].stamp_s, far_anchors[0].stamp_s)
    measurements = tuple(one for one in diagnosis.measurements if one[0] > since_s)
    innovations = tuple(one for one in diagnosis.innovations if one[0] > since_s)
    windows = diagnosis._replace(
        anchors=anchors, far_anchors=far_anchors, measurements=measurements, innovations=innovations
    )
    return replace(state, diagnosis=windows)


def _with_far_anchor(stamp_s: float, before: tuple[FilterState, ...], bare: FilterState) -> tuple[FilterState, ...]:
    kept = tuple(one for one in before if stamp_s - one.stamp_s <= LONGEST_S)
    return (*kept, bare) if not kept or stamp_s - kept[-1].stamp_s >= APART_S else kept


def without_windows(diagnosis: FaultDiagnosis) -> FaultDiagnosis:
    """Return a state of the tests that begins anew; a doubt lasts until the longer windows are tested again."""
    return diagnosis._replace(
        anchors=(), far_anchors=(), measurements=(), innovations=(), rivals=(), undecided_since_s=math.inf
    )
