"""The windows over which localizers are compared: where they begin, and what was measured since."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from trailmark.estimation.kalman.state import FaultDiagnosis, FilterState, Retrial

__all__ = ["WINDOW_S", "with_new_anchor", "without_windows"]

#: The tests look back by one to two of these: long beside the period of any localizer, short beside what a robot can
#: do about a lie [s].
WINDOW_S = 1.0

_NO_TRIALS: Mapping[str, Retrial] = MappingProxyType({})


def with_new_anchor(state: FilterState) -> FilterState:
    """Return a state whose test windows begin later: the older anchor goes, and this instant is the newer one."""
    diagnosis = state.diagnosis
    bare = replace(
        state,
        diagnosis=diagnosis._replace(
            anchors=(), measurements=(), rivals=(), undecided_since_s=math.inf, trials=_NO_TRIALS
        ),
        verdicts=(),
    )
    anchors = (*diagnosis.anchors[-1:], bare)
    since_s = anchors[0].stamp_s
    measurements = tuple(one for one in diagnosis.measurements if one[0] > since_s)
    return replace(state, diagnosis=diagnosis._replace(anchors=anchors, measurements=measurements))


def without_windows(diagnosis: FaultDiagnosis) -> FaultDiagnosis:
    """Return a state of the tests that begins anew."""
    return diagnosis._replace(anchors=(), measurements=(), rivals=(), undecided_since_s=math.inf)
