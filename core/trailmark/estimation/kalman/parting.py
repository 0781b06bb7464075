"""Motions that part steadily: by a share of the way or a yaw rate, alike in one window after the other.

What localizers state tells little of this: wheels that allow for soft ground allow for a camera that is 10 % off, too.
So the noise of a difference is what it scatters by from one short window to the next, and what is left in the mean of
many is an error that lasts, of one or of the other. Each motion is compared with that of the belief.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Collection, Iterator, Mapping
from itertools import combinations
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from trailmark.estimation.kalman.lasting_errors import NO_ERRORS, LastingVariances
from trailmark.geometry import Pose2, wrap_angle

if TYPE_CHECKING:
    from trailmark.estimation.kalman.diagnosis import MotionSum
    from trailmark.estimation.kalman.state import FilterState

__all__ = ["NOT_COMPARED", "Parting", "PartingLog", "SteadyDifference", "with_windows_compared", "without_window"]

logger = logging.getLogger(__name__)

# Length of a window, which slow motions make longer, and of one in which motions were missing [s].
_WINDOW_S, _LONGEST_S = 0.25 - 1e-6, 2.0 + 1e-6
# Over how many windows is looked back: a lie that is new shows over some seconds, a small one over a minute.
_FAST, _SLOW = 24.0, 240.0
# A difference of so many of its own standard deviations counts by half, and parts two; few windows tell theirs badly.
_HALF, _FEW = 3.0, 4.0
# Odds are 1 to 4 that the belief is the one that is wrong, as where absolute estimates contradict: whoever is right is
# within 2.3 standard deviations.
_SHARE = 1.0 / 5.0
# What is told: by so many standard deviations, in so many windows, of the way or the turn, and in yaw rate [rad/s].
_SURE, _MANY, _TOLD_SHARE, _TOLD_RADPS = 5.0, 8.0, 0.015, math.radians(0.1)
# Slower than this a window tells nothing [m].
_LEAST_WAY_M = 0.004
# A scatter that is none.
_NO_SCATTER = 1e-9


class SteadyDifference(NamedTuple):
    """How a motion differs from another per unit of way or time, in windows.

    Attributes
    ----------
    slow, slow_of, fast, fast_of : float
        Sums of the differences and of the way or time, of long ago and of late.
    scatter, n : float
        Sum of the squares of what windows differ by from those before, per unit, and how many they are.
    """

    slow: float = 0.0
    slow_of: float = 0.0
    fast: float = 0.0
    fast_of: float = 0.0
    scatter: float = 0.0
    n: float = 0.0

    def after(self, apart: float, of: float) -> SteadyDifference:
        """Return it after one more window."""
        slow, slow_of, fast, fast_of, scatter, n = self
        if fast_of > 0.0:
            surprise = apart - fast / fast_of * of
            scatter = (1.0 - 1.0 / _SLOW) * scatter + surprise * surprise / (of * (1.0 + of / fast_of))
            n = (1.0 - 1.0 / _SLOW) * n + 1.0
        return SteadyDifference(
            (1.0 - 1.0 / _SLOW) * slow + apart,
            (1.0 - 1.0 / _SLOW) * slow_of + of,
            (1.0 - 1.0 / _FAST) * fast + apart,
            (1.0 - 1.0 / _FAST) * fast_of + of,
            scatter,
            n,
        )

    def estimates(self) -> Iterator[tuple[float, float]]:
        """Yield the difference per unit and its standard deviation: of late, and of long ago; none of one window."""
        if self.n < 1.5:
            return
        # few windows: their scatter is known no better than to so much
        variance = self.scatter / self.n * (1.0 + _FEW / self.n)
        for apart, of in ((self.fast, self.fast_of), (self.slow, self.slow_of)):
            yield apart / of, math.sqrt(variance / of)


class Parting(NamedTuple):
    """How the motions of the localizers part from that of the belief.

    Attributes
    ----------
    stamp_s, pose_odom_base, sums
        Where the window begins: the instant [s], base in odom, and the sums of the steps by localizer.
    along, aside, drift : mapping of str to SteadyDifference
        By localizer, shares of the way along it and to its left, and yaw rates.
    variances : LastingVariances
        What follows for the errors of the belief that last.
    told : mapping of str to str
        By localizer, in words, what differs and is not decided.
    """

    stamp_s: float = -math.inf
    pose_odom_base: Pose2 = Pose2()
    sums: Mapping[str, MotionSum] = MappingProxyType({})
    along: Mapping[str, SteadyDifference] = MappingProxyType({})
    aside: Mapping[str, SteadyDifference] = MappingProxyType({})
    drift: Mapping[str, SteadyDifference] = MappingProxyType({})
    variances: LastingVariances = NO_ERRORS
    told: Mapping[str, str] = MappingProxyType({})


NOT_COMPARED = Parting()


class PartingLog:
    """Logs each disagreement once: the health of a belief is read by programs."""

    def __init__(self) -> None:
        self._logged: set[str] = set()

    def note(self, told: Mapping[str, str]) -> None:
        """Take note of what is told of the localizers now."""
        for source in told.keys() - self._logged:
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
    way_m = math.hypot(x, y)
    if way_m < _LEAST_WAY_M:
        return after
    along, aside, drift = dict(after.along), dict(after.aside), dict(after.drift)
    nothing = SteadyDifference()
    for source in sources:
        now, then = after.sums[source], before.sums[source]
        if now.covered_s - then.covered_s < dt_s - 1e-6:
            continue
        if now.open_ways == then.open_ways:
            own_x, own_y = now.x - then.x, now.y - then.y
            along[source] = along.get(source, nothing).after((own_x * x + own_y * y) / way_m - way_m, way_m)
            aside[source] = aside.get(source, nothing).after((own_y * x - own_x * y) / way_m, way_m)
        if now.open_turns == then.open_turns:
            drift[source] = drift.get(source, nothing).after(wrap_angle(now.turn - then.turn - turn), dt_s)
    return after._replace(along=along, aside=aside, drift=drift)


def _weighed(after: Parting, state: FilterState, sources: Collection[str]) -> Parting:
    """Return what the comparisons say of the errors of the belief, and in words."""
    told: dict[str, str] = {}
    squares = []
    for by_source, unit, per, least in (
        (after.along, "% of the way", 100.0, _TOLD_SHARE),
        (after.aside, "% of the way, aside", 100.0, _TOLD_SHARE),
        (after.drift, "deg/s", math.degrees(1.0), _TOLD_RADPS),
    ):
        seen = {source: one for source in sources if (one := _best_estimate(by_source.get(source))) is not None}
        sides = _sides(seen) if len(seen) > 1 else None
        is_belief_right = sides is None or sides.is_belief_of_most
        squares.append(0.0 if is_belief_right else max(one.counts for one in seen.values()) ** 2)
        if sides is not None and any(one.is_sure and abs(one.value) > least for one in seen.values()):
            _tell(told, sides, seen, per, unit)
    along, aside, drift = (_SHARE * one for one in squares)
    # What was wrong of the way stays so as long as it is told. Absolute estimates end nothing here: they correct how
    # the pose changes with these errors, by what they measure.
    held = after.variances if told or after.told else NO_ERRORS
    variances = LastingVariances(max(along, held.along), max(aside, held.aside), 0.0, max(drift, held.drift))
    told = {} if state.diagnosis.doubts else told
    return after._replace(variances=variances, told=told)


class _Estimate(NamedTuple):
    """A difference per unit as it counts, as it is, its standard deviation, and whether it is sure."""

    counts: float
    value: float
    sigma: float
    is_sure: bool


def _best_estimate(difference: SteadyDifference | None) -> _Estimate | None:
    if difference is None:
        return None
    best = None
    for value, sigma in difference.estimates():
        fourth = (value / (_HALF * sigma + _NO_SCATTER)) ** 4
        counts = abs(value) * math.sqrt(fourth / (1.0 + fourth))
        if best is None or counts > best.counts:
            is_sure = abs(value) > _SURE * sigma and difference.n >= _MANY
            best = _Estimate(counts, value, sigma, is_sure)
    return best


class _Sides(NamedTuple):
    """The two that differ most surely, who of them is outvoted, and whether the belief is with the others then."""

    pair: tuple[str, str]
    outvoted: str | None = None
    is_belief_of_most: bool = False


def _sides(seen: Mapping[str, _Estimate]) -> _Sides:
    one, other = max(combinations(seen, 2), key=lambda pair: _sigmas(seen[pair[0]], seen[pair[1]]))
    n = {one: 1, other: 1}
    for voter in seen.keys() - n.keys():
        for near, far in ((one, other), (other, one)):
            if _sigmas(seen[voter], seen[near]) < _HALF < _sigmas(seen[voter], seen[far]):
                n[near] += 1
    outvoted = one if n[one] == 1 < n[other] else other if n[other] == 1 < n[one] else None
    if outvoted is None:
        return _Sides((one, other))
    ally = other if outvoted == one else one
    return _Sides((one, other), outvoted, abs(seen[ally].value) < abs(seen[outvoted].value))


def _sigmas(one: _Estimate, other: _Estimate) -> float:
    return abs(one.value - other.value) / (math.hypot(one.sigma, other.sigma) + _NO_SCATTER)


def _tell(told: dict[str, str], sides: _Sides, seen: Mapping[str, _Estimate], per: float, unit: str) -> None:
    """Add in words who disagrees."""
    less, more = sorted(sides.pair, key=lambda source: seen[source].value)
    reason = f"{less} and {more} disagree by {per * (seen[more].value - seen[less].value):.1f} {unit}, steadily"
    if sides.outvoted is not None:
        told.setdefault(sides.outvoted, f"{reason}: others agree with {more if sides.outvoted == less else less}")
        return
    for source in sides.pair:
        told.setdefault(source, f"{reason}: nothing decides, and the belief covers both")
