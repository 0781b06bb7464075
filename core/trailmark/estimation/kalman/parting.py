"""Motions that part steadily: by a share of the way or of the turn, or by a velocity, alike in each window.

What localizers state tells little of this: wheels that allow for soft ground allow for a camera that is 10 % off, too.
So the noise of a difference is what it scatters by from one short window to the next, and what is left in the mean of
many is an error that lasts, of one or of the other. Each motion is compared with that of the belief. What such a mean
cannot tell from noise may be there as well, and is covered as if it were.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from trailmark.estimation.kalman.lasting_errors import NO_ERRORS, UNAFFECTED, LastingVariances
from trailmark.estimation.kalman.parting_verdict import EXPLANATIONS, KINDS, PartingVerdict, effect_of, tell
from trailmark.estimation.kalman.steady_difference import SteadyDifference
from trailmark.geometry import Pose2, wrap_angle

if TYPE_CHECKING:
    from trailmark.estimation.kalman.diagnosis import MotionSum
    from trailmark.estimation.kalman.state import FilterState

__all__ = ["NOT_COMPARED", "Parting", "PartingLog", "with_windows_compared", "without_window"]

logger = logging.getLogger(__name__)

# Length of a window, which slow motions make longer, and of one in which motions were missing [s].
_WINDOW_S, _LONGEST_S = 0.25 - 1e-6, 2.0 + 1e-6
# A window without so much of a way, or of a turn, tells nothing of a share of it [m, rad].
_LEAST_WAY_M, _LEAST_TURN_RAD = 0.004, 0.01
# Of two explanations the one that fits so much worse than the other is none.
_FITS = 0.7
# An absolute estimate of a whole pose says for so long that motions hide nothing [s].
_PLACED_S = 8.0

_NO_DIFFERENCE = SteadyDifference()


class Parting(NamedTuple):
    """How the motions of the localizers part from that of the belief.

    Attributes
    ----------
    stamp_s, pose_odom_base, sums
        Where the window begins: the instant [s], base in odom, and the sums of the steps by localizer.
    differences : mapping of str to mapping of str to SteadyDifference
        By the name of a field of `LastingVariances`, and by localizer.
    variances : LastingVariances
        What follows for the errors of the belief that last.
    told : mapping of str to str
        By localizer, in words, what differs and is not decided.
    lasts : mapping of str to float
        By the name of a field of `LastingVariances`, what was seen of those that are told: one of each two that explain
        the same.
    """

    stamp_s: float = -math.inf
    pose_odom_base: Pose2 = Pose2()
    sums: Mapping[str, MotionSum] = MappingProxyType({})
    differences: Mapping[str, Mapping[str, SteadyDifference]] = MappingProxyType({})
    variances: LastingVariances = NO_ERRORS
    told: Mapping[str, str] = MappingProxyType({})
    lasts: Mapping[str, float] = MappingProxyType({})


NOT_COMPARED = Parting()


class PartingLog:
    """Logs each disagreement once: the health of a belief is read by programs."""

    def __init__(self) -> None:
        self._logged: set[str] = set()

    def note(self, told: Mapping[str, str]) -> None:
        """Take note of what is told of the localizers now."""
        for source in [one for one in told if one not in self._logged]:
            if told[source] not in self._logged:
                logger.warning("localizer %r: %s", source, told[source])
            self._logged |= {source, told[source]}


def with_windows_compared(state: FilterState, calibrated: Collection[str]) -> FilterState:
    """Return a state after the comparison of the last window, if one is over.

    Parameters
    ----------
    state : FilterState
        With the sums of all motions.
    calibrated : collection of str
        Localizers whose lasting errors are estimated, not considered.
    """
    before, diagnosis, odometry = state.diagnosis.parting, state.diagnosis, state.odometry
    dt_s = state.stamp_s - before.stamp_s
    if dt_s < _WINDOW_S:
        return state
    after = before._replace(stamp_s=state.stamp_s, pose_odom_base=odometry.pose_odom_base, sums=diagnosis.sums)
    if dt_s <= _LONGEST_S:
        left_out = {*diagnosis.faults, *calibrated}
        sources = [source for source in diagnosis.sums if source in before.sums and source not in left_out]
        after = _compared(after, before, sources, dt_s)
        after = _weighed(after, state, sources)
    return state.with_diagnosis(diagnosis._replace(parting=after))


def without_window(state: FilterState) -> FilterState:
    """Return a state whose next window begins anew: while filters disagree on who is right there is no one belief."""
    parting = state.diagnosis.parting
    if parting.stamp_s == -math.inf:
        return state
    return state.with_diagnosis(state.diagnosis._replace(parting=parting._replace(stamp_s=-math.inf)))


def _compared(after: Parting, before: Parting, sources: Collection[str], dt_s: float) -> Parting:
    begin, end = before.pose_odom_base, after.pose_odom_base
    x, y, turn = end.x - begin.x, end.y - begin.y, wrap_angle(end.theta - begin.theta)
    way_m, turn_rad = math.hypot(x, y), abs(turn)
    if way_m < _LEAST_WAY_M and turn_rad < _LEAST_TURN_RAD:
        return after
    cos, sin = math.cos(begin.theta + 0.5 * turn), math.sin(begin.theta + 0.5 * turn)
    differences = {name: dict(after.differences.get(name, ())) for name in KINDS}

    def note(name: str, source: str, apart: float, of: float) -> None:
        differences[name][source] = differences[name].get(source, _NO_DIFFERENCE).after(apart, of)

    for source in sources:
        now, then = after.sums[source], before.sums[source]
        if now.covered_s - then.covered_s < dt_s - 1e-6:
            continue
        if now.open_ways == then.open_ways:
            dx, dy = now.x - then.x - x, now.y - then.y - y
            note("ahead", source, cos * dx + sin * dy, dt_s)
            note("left", source, cos * dy - sin * dx, dt_s)
            if way_m >= _LEAST_WAY_M:
                note("along", source, (dx * x + dy * y) / way_m, way_m)
                note("aside", source, (dy * x - dx * y) / way_m, way_m)
        if now.open_turns == then.open_turns:
            turned = wrap_angle(now.turn - then.turn - turn)
            note("drift", source, turned, dt_s)
            if turn_rad >= _LEAST_TURN_RAD:
                note("turn", source, math.copysign(turned, turned * turn), turn_rad)
    return after._replace(differences=differences)


def _is_placed(state: FilterState) -> bool:
    """Return whether whole poses were accepted of late: what motions hide shows in them."""
    agreed = state.rejections.corroborations.values()
    return any(state.stamp_s - one.stamp_s <= _PLACED_S and len(one.directions) == 3 for one in agreed)


def _weighed(after: Parting, state: FilterState, sources: Collection[str]) -> Parting:
    """Return what the comparisons say of the errors of the belief, and in words."""
    told: dict[str, str] = {}
    columns = UNAFFECTED if state.gaussian is None else state.gaussian.lasting
    # What was wrong stays so as long as it is told, by one explanation. Absolute estimates end nothing here: they
    # correct how the pose changes with these errors, by what they measure.
    variances: dict[str, float] = {}
    lasts: dict[str, float] = {}
    is_placed = _is_placed(state)
    for names in EXPLANATIONS:
        found = {name: PartingVerdict.of(name, after.differences.get(name, {}), sources) for name in names}
        effects = {name: effect_of(columns, name) for name in names}
        best = max(one.sigmas for one in found.values())
        fits = [name for name in names if found[name].sigmas >= _FITS * best]
        explains = max(fits, key=lambda name: found[name].parts * effects[name])
        hides = max(names, key=lambda name: found[name].hidden * effects[name])
        parts = {name: after.lasts[name] for name in names if name in after.lasts}
        parts[explains] = max(parts.get(explains, 0.0), found[explains].parts)
        most = max(fits, key=lambda name: found[name].sigmas)
        if found[most].is_told:
            tell(told, found[most], KINDS[most])
            explains = max(parts, key=lambda name: parts[name] * effects[name])
            variances[explains] = lasts[explains] = parts[explains]
        else:
            variances[explains] = found[explains].parts
        if not is_placed:
            variances[hides] = variances.get(hides, 0.0) + found[hides].hidden
    told = {} if state.diagnosis.doubts else told
    return after._replace(variances=LastingVariances(**variances), told=told, lasts=lasts)
