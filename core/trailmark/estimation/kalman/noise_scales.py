"""How many times as wrong as it says each localizer is: learned from what localizers say of the same motion.

The difference of what several say has the covariance ``v_1 C_1 + v_2 C_2 + ...``, with C what they state and v the
squares of their scales. The likeliest v are found as variance components (multiplicative steps towards equality of the
two sides of the likelihood equations; H. Zhou et al., J. Computational and Graphical Statistics 28, 2019), from the
differences of the last minute, each clipped where chance would not take it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping
from collections.abc import Set as AbstractSet
from itertools import combinations
from types import MappingProxyType

from trailmark.estimates import Fix, Motion
from trailmark.estimation.kalman.clock_offsets import TimeOffset
from trailmark.estimation.kalman.delays_in_fixes import DelaysInFixes, StackedDifferences
from trailmark.estimation.kalman.leading_motion import Corrected, LeadingMotion
from trailmark.estimation.kalman.noise_in_dispute import is_lasting, is_white, noise_of_alternating
from trailmark.estimation.kalman.noise_residuals import (
    FixRow,
    FixTrack,
    RecentMotions,
    Residual,
    fix_residual,
    motion_residual,
    stamps_apart,
)
from trailmark.estimation.kalman.variance_components import (
    AT_ITS_WORD,
    AT_ITS_WORD_AGAIN,
    FALLS,
    GROWS,
    MOST,
    Key,
    Pairing,
    Shares,
    both_sides,
)
from trailmark.estimation.symmetric import Sym3, inverse, scaled

__all__ = ["NoiseScales", "told_scale"]

#: Motion is compared over windows of this length, absolute estimates over at most this [s].
_WINDOW_S, _LONGEST_S = 1.0, 10.0
#: Absolute estimates that are compared are this far apart [s].
_APART_S = 0.2
#: An error that is constant in place shows over this way [m].
_LONG_WAY_M = 1.0
#: What was said is compared so much later: by then it is known who lies [s].
_DELAY_S = 2.0
_EVERY_S, _STEPS = 1.0, 4
#: Differences that are kept of each kind, and how many numbers of them say something; of a motion what is evident.
_KEPT, _ENOUGH, _FEW = 60, 24.0, 6.0
#: Standard deviations of a scale that it must be away from one, and where few numbers say so.
_SURE, _SURE_OF_FEW = 4.0, 7.0
#: Evidence, and how much of it is news, where it is certain.
_CERTAIN = (math.inf, math.inf)
#: How long errors last where they do not.
_NONE_LAST: Mapping[str, float] = MappingProxyType({})


class NoiseScales:
    """Learns the scale of the stated standard deviations of each localizer, slowly and within bounds.

    Upwards alone: who has erred by less than it says stays at its word, because what it allows for may come.
    """

    def __init__(self) -> None:
        self._motions: dict[str, RecentMotions] = {}
        self._fixes: dict[str, FixTrack] = {}
        self._differences: dict[Pairing, deque[Residual]] = {}
        self._logs: dict[Key, float] = {}
        self._accused: dict[str, tuple[float, float]] = {}
        self._compared_s: dict[str, float] = {}
        #: Differences in a row while somebody was accused.
        self._doubted: dict[Pairing, deque[Residual]] = {}
        self._leading = LeadingMotion()
        self._delays = DelaysInFixes()
        #: When each told motion last, and its information per second.
        self._certainty: dict[str, tuple[float, float]] = {}
        self._far_s: dict[str, float] = {}
        self._next_s = -math.inf
        self._used: dict[Key, float] = {}
        self._evidence: dict[Key, tuple[float, float]] = {}

    def begin_anew(self) -> NoiseScales:
        """Return scales that learn from now on, at any time, and begin with those that are used."""
        anew = NoiseScales()
        anew._used = dict(self._used)
        anew._logs = {key: self._logs[key] for key in self._used}
        anew._leading.logs.update((key, log) for key, log in self._leading.logs.items() if key in self._used)
        return anew

    def believed_of_motion(self, source: str, motion: Motion, stated: Sym3) -> Sym3:
        """Take note of a motion, and return its information as it is believed."""
        track = self._motions.get(source)
        if track is None:
            track = self._motions[source] = RecentMotions()
        step = motion.pose_since_now
        track.add((motion.since_s, motion.stamp_s, step.x, step.y, step.theta, *stated))
        believed = self._scaled((source, True), stated)
        self._certainty[source] = motion.stamp_s, (believed[0] + believed[3]) * (motion.stamp_s - motion.since_s)
        return believed

    def believed_of_fix(self, source: str, fix: Fix, stated: Sym3) -> Sym3:
        """Take note of an absolute pose, and return its information as it is believed."""
        covariance = inverse(stated)
        if covariance is not None:
            track = self._fixes.get(source)
            if track is None:
                track = self._fixes[source] = FixTrack()
            pose = fix.pose_map_base
            track.add((fix.stamp_s, pose.x, pose.y, pose.theta, covariance))
        return self._scaled((source, False), stated)

    def scales(self) -> Mapping[str, float]:
        """Return by which factor stated standard deviations are multiplied, by localizer, where that is not one.

        Of the scales of its motion and of its absolute estimates it is the larger.
        """
        found: dict[str, float] = {}
        for (source, _), scale in sorted(self._used.items()):
            found[source] = max(scale, found.get(source, 0.0))
        return found

    def delays(self) -> Mapping[str, TimeOffset]:
        """Return how late the absolute poses of each localizer seem against the motions, certain or not."""
        return self._delays.found

    def is_due(self, stamp_s: float) -> bool:
        """Return whether it is time to compare."""
        return stamp_s >= self._next_s

    def compare(
        self,
        stamp_s: float,
        accused: AbstractSet[str],
        corrected: Corrected | None,
        correlations_s: Mapping[str, float] = _NONE_LAST,
    ) -> None:
        """Compare what was said until a while ago, and move the scales; nothing is learned from the accused.

        Parameters
        ----------
        stamp_s : float
            The newest stamp [s].
        accused : set of str
            Localizers that may lie.
        corrected : (ndarray, ndarray) or None
            Corrections by absolute estimates and their covariance, each added up since the beginning, (3,) and (3, 3).
        correlations_s : dict of str to float
            How long the errors of the absolute estimates of a localizer last, where they do [s].
        """
        dt_s = min(stamp_s - self._next_s + _EVERY_S, 2.0 * _EVERY_S) if self._next_s > -math.inf else 0.0
        self._next_s = stamp_s + _EVERY_S
        for source in accused:
            since_s, last_s = self._accused.get(source, (stamp_s, stamp_s))
            self._accused[source] = (since_s if stamp_s - last_s <= _DELAY_S else stamp_s, stamp_s)
        if len(self._motions) + len(self._fixes) < 2 or not self._motions:
            return
        until_s = stamp_s - _DELAY_S
        self._compare_motions(until_s)
        self._compare_fixes(until_s)
        self._estimate(correlations_s)
        leader = self._leader(until_s)
        if corrected is not None and leader is not None and not accused:
            self._leading.observe(stamp_s, (leader, True), *corrected)
        for key, log in self._leading.logs.items():
            if log > self._logs.get(key, 0.0):
                self._logs[key], self._evidence[key] = log, _CERTAIN
        self._move(dt_s)

    def _scaled(self, key: Key, information: Sym3) -> Sym3:
        scale = self._used.get(key)
        return information if scale is None else scaled(information, 1.0 / (scale * scale))

    def _leader(self, since_s: float) -> str | None:
        """Return whose motion is surest per second, of those that told any since then."""
        told = {source: sure for source, (stamp_s, sure) in self._certainty.items() if stamp_s >= since_s}
        return max(told, key=told.__getitem__, default=None)

    def _compare_motions(self, until_s: float) -> None:
        for (a, first), (b, second) in combinations(sorted(self._motions.items()), 2):
            sparse = first if first.mean_interval_s >= second.mean_interval_s else second
            chain = sparse.chain()
            if chain is None:
                continue
            pair = f"{a} {b}"
            done_s = self._compared_s.get(pair, -math.inf)
            for since_s, end_s in stamps_apart(chain, done_s, _WINDOW_S):
                if end_s > until_s:
                    break
                self._compared_s[pair] = end_s
                found = motion_residual(first, second, since_s, end_s)
                if found is not None:
                    self._keep("motion", ((a, True), (b, True)), found)

    def _compare_fixes(self, until_s: float) -> None:
        for source, track in self._fixes.items():
            rows = [row for row in track.rows if row[0] <= until_s]
            done_s = self._compared_s.get(source, -math.inf)
            for index, later in enumerate(rows):
                if later[0] < done_s + _APART_S:
                    continue
                self._compared_s[source] = done_s = later[0]
                for kind, other, earlier in self._earlier(source, rows[:index], later):
                    for name, motion in self._motions.items():
                        found = fix_residual(earlier, later, motion)
                        if found is not None:
                            self._keep(kind, ((other, False), (source, False), (name, True)), found)

    def _earlier(self, source: str, rows: list[FixRow], later: FixRow) -> Iterator[tuple[str, str, FixRow]]:
        """Yield poses that one is compared with: how they relate, whose they are, and they."""
        near = next((row for row in reversed(rows) if row[0] <= later[0] - _APART_S), None)
        if near is not None and later[0] - near[0] <= _WINDOW_S:
            yield "near", source, near
        far = next((row for row in rows if row[0] >= later[0] - _LONGEST_S), later)
        if (
            math.dist(far[1:3], later[1:3]) >= _LONG_WAY_M
            and later[0] - self._far_s.get(source, -math.inf) >= _WINDOW_S
        ):
            self._far_s[source] = later[0]
            yield "long", source, far
        for other, track in self._fixes.items():
            if other == source:
                continue
            last = next((row for row in reversed(track.rows) if row[0] <= later[0]), None)
            if last is not None and later[0] - last[0] <= _WINDOW_S:
                yield "other", other, last

    def _keep(self, kind: str, keys: tuple[Key, ...], found: Residual) -> None:
        """Keep a difference, unless somebody was accused then whom it is about."""
        for source, _ in keys:
            since_s, last_s = self._accused.get(source, (math.inf, -math.inf))
            if found.since_s <= last_s + _WINDOW_S and found.stamp_s >= since_s - _DELAY_S:
                if kind in ("near", "motion"):
                    _append(self._doubted.setdefault((kind, keys), deque(maxlen=_KEPT)), found)
                return
        self._doubted.pop((kind, keys), None)
        _append(self._differences.setdefault((kind, keys), deque(maxlen=_KEPT)), found)

    def _estimate(self, correlations_s: Mapping[str, float]) -> None:
        """Move the scales towards those that make what was seen likeliest."""
        white = {which: kept for which, kept in self._doubted.items() if which[0] == "motion" and is_white(kept)}
        of_noise = {
            which: kept
            for which, kept in (self._differences | white).items()
            if not (which[0] == "motion" and is_lasting(kept))  # see `lasting_doubts`
        }
        stacked = {which: StackedDifferences.of(kept) for which, kept in of_noise.items()}
        self._delays.fit(stacked, self._logs, correlations_s)
        self._evidence = {}
        shares = Shares()
        for _ in range(_STEPS):
            before, shares = dict(self._logs), Shares()
            for (kind, keys), stack in stacked.items():
                covariances = stack.scale_covariances(keys, self._logs)
                seen, expected, told = both_sides(self._delays.values_of(keys, stack), covariances)
                for index, key in enumerate(keys):
                    sides = float(seen[index]), float(expected[index])
                    news = stack.share_of_news if key[1] else 1.0
                    shares.add(key, kind, keys, sides, news * float(told[index]))
            for key in shares.localizers():
                log = self._logs.get(key, 0.0) + 0.25 * math.log(shares.ratio_of(key))
                self._logs[key] = min(max(log, 0.0), math.log(MOST))
                self._evidence[key] = shares.evidence(key)
            if self._logs == before:  # all at their bounds: further steps are the same
                break
        for (kind, keys), kept in self._doubted.items():
            noise = noise_of_alternating(kept) if kind == "near" else None
            if noise is not None:
                self._logs[keys[0]] = min(max(0.5 * math.log(noise), 0.0), math.log(MOST))
                self._evidence[keys[0]] = _CERTAIN

    def _move(self, dt_s: float) -> None:
        """Let the scales that are used follow those that were found."""
        for key, log in self._logs.items():
            (evidence, told), scale = self._evidence.get(key, (0.0, 0.0)), self._used.get(key)
            sigma = 0.5 * math.sqrt(2.0 / max(told, 1.0))
            if scale is None:
                enough, sure = (_FEW, _SURE_OF_FEW) if key[1] and evidence < _ENOUGH else (_ENOUGH, _SURE)
                if evidence < enough or log < max(math.log(AT_ITS_WORD), sure * sigma):
                    continue
                scale = 1.0
            target = 1.0 if log < math.log(AT_ITS_WORD_AGAIN) else math.exp(log)
            moved = min(max(target, scale * FALLS**dt_s), scale * GROWS**dt_s)
            if target == 1.0 and moved < 1.01:
                self._used.pop(key, None)
            else:
                self._used[key] = moved


def _append(kept: deque[Residual], found: Residual) -> None:
    """Keep a difference; where motion is compared by its heading alone from now on, or no more, begin anew."""
    if kept and kept[-1].value.shape != found.value.shape:
        kept.clear()
    kept.append(found)


def told_scale(scale: float) -> str:
    """Return in words that a localizer is not taken at its word."""
    return f"it is {scale:.2g} times as wrong as it says, and believed accordingly"
