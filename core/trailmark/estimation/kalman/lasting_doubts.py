"""Motions that differ for seconds by more than their noise, and by less than honest calibrations may.

No test accuses anybody then, and weights by what each states would follow the one that states most. So whoever is
outvoted, or each of two where nobody votes, has an error that lasts, as large as the difference: it counts for so much
less, and what the belief still takes from it is in its covariance.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from trailmark.estimation.kalman.agreement import Tolerance, agreeing_groups, disagreement_within, motion_since
from trailmark.estimation.kalman.diagnosis import LastingDoubt
from trailmark.estimation.kalman.motion_steps import MotionStep, weakened_by
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.symmetric import ZERO, add, diagonal

__all__ = ["doubts_of", "with_doubts"]

# What localizers state, and calibrations as good as they get.
_AS_STATED = Tolerance(0.002, math.radians(0.02))
# By how much better the motions of one group agree than those of another of its size: odds of 50 to 1.
_DECIDED = 2.0 * math.log(50.0)
# So many absolute estimates in the windows tell who is wrong by themselves, and sooner.
_MANY = 8
# For how long such an error is the same: as the tests look back [s].
_LASTS_S = 8.0


def doubts_of(state: FilterState, trusted: Sequence[str]) -> Mapping[str, LastingDoubt]:
    """Return whose motion differs from that of others, and how fast, over the longest window in which it shows.

    Parameters
    ----------
    state : FilterState
        With the anchors at which the windows begin.
    trusted : sequence of str
        Localizers whose motion is believed.
    """
    if len(state.diagnosis.measurements) >= _MANY:
        return {}
    for anchor in state.diagnosis.far_anchors:
        groups = agreeing_groups(state, anchor, trusted, _AS_STATED)
        if len(groups) > 1:
            outvoted = _outvoted(state, anchor, groups)
            return {source: _doubt_of(state, anchor, source, trusted) for source in trusted if source in outvoted}
    return {}


def with_doubts(
    steps: Sequence[tuple[str, MotionStep]], doubts: Mapping[str, LastingDoubt], dt_s: float
) -> list[tuple[str, MotionStep]]:
    """Return steps, by localizer, less certain by the errors that last.

    Parameters
    ----------
    steps : sequence of (str, MotionStep)
        As they were told.
    doubts : mapping of str to LastingDoubt
        By localizer.
    dt_s : float
        Length of the steps [s].
    """
    return [(source, _doubted(step, doubts[source], dt_s) if source in doubts else step) for source, step in steps]


def _outvoted(state: FilterState, anchor: FilterState, groups: Sequence[frozenset[str]]) -> frozenset[str]:
    """Return the localizers outside of the largest group that agrees best; outside of any, where several do."""
    largest = max(map(len, groups))
    nis_of = {
        group: disagreement_within(state, anchor, sorted(group), _AS_STATED)
        for group in groups
        if len(group) == largest
    }
    best = [group for group, nis in nis_of.items() if nis <= min(nis_of.values()) + _DECIDED]
    return frozenset().union(*groups) - frozenset.intersection(*best)


def _doubt_of(state: FilterState, anchor: FilterState, source: str, trusted: Sequence[str]) -> LastingDoubt:
    """Return how fast a motion and those that disagree with it part."""
    own = motion_since(state, anchor, source)
    dt_s, apart_mps, apart_radps = state.stamp_s - anchor.stamp_s, 0.0, 0.0
    for other in trusted:
        motion = motion_since(state, anchor, other)
        if own is None or motion is None or len(agreeing_groups(state, anchor, [source, other], _AS_STATED)) < 2:
            continue
        apart_mps = max(apart_mps, math.hypot(own.x - motion.x, own.y - motion.y) / dt_s)
        apart_radps = max(apart_radps, abs(own.turn - motion.turn) / dt_s)
    known = state.diagnosis.doubts.get(source)
    return LastingDoubt(apart_mps, apart_radps, state.stamp_s if known is None else known.since_s)


def _doubted(step: MotionStep, doubt: LastingDoubt, dt_s: float) -> MotionStep:
    position_m2 = 2.0 * _LASTS_S * dt_s * doubt.apart_mps**2
    added = diagonal(position_m2, position_m2, 2.0 * _LASTS_S * dt_s * doubt.apart_radps**2)
    if step.covariance is not None:
        return replace(step, covariance=add(step.covariance, added))
    return replace(step, information=weakened_by(step.information or ZERO, added))
