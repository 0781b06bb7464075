"""The windows over which localizers are compared: where they begin, and what was measured since."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from trailmark.estimation.kalman.state import Consistency, FilterState, Retrial

__all__ = ["WINDOW_S", "with_new_anchor", "without_windows"]

#: The tests look back by one to two of these: long beside the period of any localizer, short beside what a robot can
#: do about a lie [s].
WINDOW_S = 1.0

_NO_TRIALS: Mapping[str, Retrial] = MappingProxyType({})


def with_new_anchor(state: FilterState) -> FilterState:
    """Return a state whose test windows begin later: the older anchor goes, and this instant is the newer one."""
    consistency = state.consistency
    bare = replace(
        state,
        consistency=consistency._replace(
            anchors=(), measurements=(), rivals=(), undecided_since_s=math.inf, trials=_NO_TRIALS
        ),
        verdicts=(),
    )
    anchors = (*consistency.anchors[-1:], bare)
    since_s = anchors[0].stamp_s
    measurements = tuple(one for one in consistency.measurements if one[0] > since_s)
    return replace(state, consistency=consistency._replace(anchors=anchors, measurements=measurements))


def without_windows(consistency: Consistency) -> Consistency:
    """Return a state of the tests that begins anew."""
    return consistency._replace(anchors=(), measurements=(), rivals=(), undecided_since_s=math.inf)
