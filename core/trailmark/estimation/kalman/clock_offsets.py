"""By how much the stamps of one localizer are off against those of another: turns and ways that both tell say it.

Two localizers that watch one drive tell the same turns and ways. Where the stamps of one are late, what it tells looks
like what the other told some time before. Over the last seconds the shift is looked for at which they differ least:
motions by turns and ways, fixes by where they lie beside the way that the motions of another make. How sharply they
begin to differ beside it says how well it is known. A drive that neither turns nor changes its speed says nothing, and
nothing is told.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.deprecation import deprecated_name
from trailmark.estimates import Estimate, Fix, Motion
from trailmark.estimation.kalman.clock_places import cost_beside_drift, cost_of_places
from trailmark.estimation.kalman.clock_tracks import (
    FARTHEST_S,
    HEADING,
    POSITION_M2,
    TURN_RAD2,
    WAY,
    WINDOW_S,
    RecentPoses,
)

__all__ = ["TOLD_S", "ClockOffsets", "TimeOffset", "warn_of_offset"]

logger = logging.getLogger(__name__)

_EVERY_S = 2.0
_INTERVAL_S, _LEAST_INTERVALS = 0.25, 12
_STEP_S = 0.02
_SHIFTS_S: Floats = np.arange(-FARTHEST_S, FARTHEST_S + _STEP_S / 2.0, _STEP_S)
#: Beside the lowest cost, this far away, it must stand out by so much from all others [s].
_ASIDE_S, _STANDS_OUT = 0.1, 40.0
_INTERVALS = WINDOW_S / _INTERVAL_S
_LEAST_SPREAD = 1e-6
#: Information of a heading from which on it is one [1/rad^2].
_LEAST_HEADING = 1.0
#: Offsets from here on are told, when they are so many sigmas from nothing.
TOLD_S, _SURE = 0.02, 5.0
#: From so many on at once: noise bends the costs, too, and what stands out of it looks surer than it is. With fewer,
#: when it is found again in rows of which none was in the first, and both agree by so many.
_SURE_AT_ONCE, _AGREES = 7.0, 3.0
#: What differs by more than so many times its usual is left out: slip, jumps.
_OUTLIER = 4.0


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """How late the stamps of a localizer are, against those of another.

    Attributes
    ----------
    against : str
        The other localizer.
    late_s, sigma_s : float
        Positive where its stamps are later than they should be; standard deviation [s].
    """

    against: str
    late_s: float
    sigma_s: float

    @property
    def is_certain(self) -> bool:
        """Whether there is an offset worth telling."""
        return abs(self.late_s) >= TOLD_S and abs(self.late_s) > _SURE * self.sigma_s

    def __str__(self) -> str:
        what = "late" if self.late_s > 0.0 else "early"
        return (
            f"its stamps are {abs(self.late_s) * 1e3:.0f} +- {self.sigma_s * 1e3:.0f} ms {what} against {self.against}"
        )


class ClockOffsets:
    """Compares the localizers two by two while the drive goes on; what it costs is bounded."""

    def __init__(self) -> None:
        self._tracks: dict[str, RecentPoses] = {}
        self._next_s = -math.inf
        #: Offsets that were found once, and when, by localizer.
        self._found_once: dict[str, tuple[float, TimeOffset]] = {}
        #: Offsets that are certain, by localizer; one stays until another is found for it.
        self.certain: dict[str, TimeOffset] = {}

    def begin_anew(self) -> ClockOffsets:
        """Return what begins at another time: it keeps the offsets that are certain, and who is compared with whom."""
        fresh = ClockOffsets()
        fresh.certain = self.certain
        fresh._tracks = {source: RecentPoses(track.of_motion) for source, track in self._tracks.items()}
        return fresh

    def observe(self, source: str, estimate: Estimate) -> Mapping[str, TimeOffset]:
        """Take note of an estimate; returns offsets that became certain by it, by localizer.

        Parameters
        ----------
        source : str
            Name of the localizer.
        estimate : Estimate
            What it said, and was not refused.
        """
        if not isinstance(estimate, Motion) and not (
            isinstance(estimate, Fix) and _knows_heading(estimate.information)
        ):
            return {}
        track = self._tracks.get(source)
        if track is None:
            track = self._tracks[source] = RecentPoses(isinstance(estimate, Motion))
        if track.of_motion == isinstance(estimate, Motion):
            track.add(estimate)
        if len(self._tracks) < 2 or estimate.stamp_s < self._next_s:
            return {}
        self._next_s = estimate.stamp_s + _EVERY_S
        return self._compare_all(estimate.stamp_s)

    def note(self, source: str, estimate: Estimate) -> None:
        """Take note of an estimate, and warn of what is found by it."""
        for name, found in self.observe(source, estimate).items():
            warn_of_offset(name, found)

    def is_due(self, stamp_s: float) -> bool:
        """Return whether an estimate of this stamp may make the localizers be compared."""
        return stamp_s >= self._next_s

    def forget(self, source: str) -> None:
        """Forget what a localizer said: it is not believed."""
        track = self._tracks.get(source)
        if track is not None:
            track.clear()

    def _compare_all(self, stamp_s: float) -> Mapping[str, TimeOffset]:
        """Compare every localizer with the first that tells motion, at a stamp."""
        reference = next((name for name, track in self._tracks.items() if track.of_motion), None)
        if reference is None:
            return {}
        news = {}
        for source, track in self._tracks.items():
            found = None if source == reference else _compare(track, self._tracks[reference], reference)
            if found is None:
                continue
            known = self.certain.get(source)
            if not found.is_certain:
                self.certain.pop(source, None)
                continue
            if known is None and not self._is_confirmed(source, found, stamp_s):
                continue
            self.certain[source] = found
            if known is None or abs(found.late_s - known.late_s) > max(TOLD_S, _SURE * found.sigma_s):
                news[source] = found
        return news

    def _is_confirmed(self, source: str, found: TimeOffset, stamp_s: float) -> bool:
        """Return whether an offset is beyond doubt, or was found before in other rows; keep it if it is new."""
        if abs(found.late_s) > _SURE_AT_ONCE * found.sigma_s:
            return True
        once_s, once = self._found_once.get(source, (-math.inf, found))
        agrees = abs(found.late_s - once.late_s) <= _AGREES * math.hypot(found.sigma_s, once.sigma_s)
        if once_s == -math.inf or not agrees:
            self._found_once[source] = stamp_s, found
            return False
        return stamp_s - once_s >= WINDOW_S + 2.0 * FARTHEST_S


def warn_of_offset(source: str, found: TimeOffset) -> None:
    """Log what is found of the stamps of a localizer, and the key that mends it."""
    logger.warning("localizer %r: %s; set time_offset_s: %.3f for its source", source, found, -found.late_s)


def _knows_heading(information: Floats) -> bool:
    """Return whether a fix tells the heading by itself, and not only together with where the robot is."""
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = information.tolist()
    determinant = xx * yy - xy * xy
    if determinant <= 0.0:
        return bool(xt == yt == 0.0 and tt > 0.0)
    return bool(tt - (xt * (yy * xt - xy * yt) + yt * (xx * yt - xy * xt)) / determinant > _LEAST_HEADING)


def _compare(track: RecentPoses, reference: RecentPoses, against: str) -> TimeOffset | None:
    """Return the shift at which two tracks differ least; None where they do not tell."""
    rows, other = _thinned(track.table()), reference.table()
    if len(rows) <= _LEAST_INTERVALS or len(other) <= _LEAST_INTERVALS:
        return None
    rows = rows[(rows[:, 0] >= other[0, 0] + FARTHEST_S) & (rows[:, 0] <= other[-1, 0] - FARTHEST_S)]
    if len(rows) <= _LEAST_INTERVALS:
        return None
    # A stamp that is late by tau names what the other told of t - tau.
    at_s = rows[:, 0] - _SHIFTS_S[:, np.newaxis]
    if track.of_motion:
        expected = [np.interp(at_s, other[:, 0], other[:, column]) for column in (HEADING, WAY)]
        costs = [_cost_of_steps(rows[:, column], then) for column, then in zip((HEADING, WAY), expected)]
        return _lowest(np.asarray(sum(costs)), against)
    x, y = (np.interp(at_s, other[:, 0], other[:, column]) for column in (1, 2))
    found = _lowest(cost_of_places(rows[:, 1] + 1j * rows[:, 2], x + 1j * y), against)
    if found is None or not found.is_certain:
        return found
    walks = [np.interp(at_s, other[:, 0], other[:, column]) for column in (POSITION_M2, TURN_RAD2)]
    way = np.stack([at_s, x, y, *walks], axis=-1)
    return _lowest(cost_beside_drift(rows[:, [1, 2, POSITION_M2]], way), against)


def _cost_of_steps(told: Floats, expected: Floats) -> Floats:
    """Return how badly turns or ways between rows, (N,), agree at each shift, (S, N) to (S,), in chi squares."""
    misses = np.diff(told) - np.diff(expected, axis=1)
    misses -= np.median(misses, axis=1, keepdims=True)  # a bias of a gyro, a wrong radius of a wheel
    spread = max(1.4826 * float(np.median(np.abs(misses), axis=1).min()), _LEAST_SPREAD)
    return np.asarray(np.minimum((misses / spread) ** 2, _OUTLIER**2).sum(axis=1))


def _thinned(rows: Floats) -> Floats:
    """Return rows that are so far apart that what happens between them stands out of the noise."""
    kept, last_s = [], -math.inf
    for index, stamp_s in enumerate(rows[:, 0].tolist()):
        if stamp_s >= last_s + _INTERVAL_S:
            kept.append(index)
            last_s = stamp_s
    return rows[kept]


def _lowest(costs: Floats, against: str) -> TimeOffset | None:
    """Return where the costs are lowest; None where that does not stand out, or lies beyond what was looked at."""
    best = int(costs.argmin())
    aside = round(_ASIDE_S / _STEP_S)
    if not aside <= best < len(costs) - aside:
        return None
    lowest = float(costs[best])
    elsewhere = np.abs(_SHIFTS_S - _SHIFTS_S[best]) > 1.5 * _ASIDE_S
    if float(costs[elsewhere].min()) - lowest < _STANDS_OUT * max(1.0, lowest / _INTERVALS):
        return None
    near = slice(best - 2, best + 3)
    bend, slope, _ = np.polyfit(_SHIFTS_S[near] - _SHIFTS_S[best], costs[near], 2)
    wide = float(costs[best - aside] + costs[best + aside] - 2.0 * lowest) / (2.0 * _ASIDE_S**2)
    if bend <= 0.0 or wide <= 0.0:
        return None
    moved_s = min(max(-slope / (2.0 * bend), -2.0 * _STEP_S), 2.0 * _STEP_S)
    return TimeOffset(against, float(_SHIFTS_S[best] + moved_s), math.sqrt(1.0 / min(bend, wide)))


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {"ClockOffset": TimeOffset})
