"""What is learned of the localizers beside the state: their clocks, how wrong they are, and how long errors last."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import replace

from trailmark.estimates import Estimate, Fix, Motion
from trailmark.estimation.kalman.clock_offsets import TOLD_S, ClockOffsets, TimeOffset, warn_of_offset
from trailmark.estimation.kalman.correlation_times import CorrelationTimes
from trailmark.estimation.kalman.fault_detection import accused_sources, outvoted_motions
from trailmark.estimation.kalman.noise_scales import NoiseScales, told_scale
from trailmark.estimation.kalman.state import FilterState, Verdict
from trailmark.estimation.kalman.timeline import Timeline
from trailmark.estimation.kalman.trust import Trust
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.symmetric import Sym3

__all__ = ["SourceLearning"]

#: A delay of so many sigmas is told and used, until it is less than the last; more is asked where errors of poses last,
#: because how long they do is learned too.
_SURE, _SURE_OF_LASTING, _STILL_SURE = 4.0, 5.0, 2.0
#: One of so many may be why the belief is corrected to one side.
_LIKELY = 1.5


class SourceLearning:
    """Corrects what localizers say by what they have said before: stamps, certainty, and how much of it is news.

    Parameters
    ----------
    config : KalmanConfig
        Of the estimator: which of it is learned, and which is used.
    counted : Counter of str
        Takes how many stamps were corrected.
    """

    def __init__(self, config: KalmanConfig, counted: Counter[str]) -> None:
        self._config = config
        self._counted = counted
        self._offsets = ClockOffsets()
        self._noise = NoiseScales() if config.learn_scales else None
        self._correlations = CorrelationTimes()
        #: Offsets that show only over a minute, and by how much the last stamp of each localizer was moved [s].
        self._slow_offsets: dict[str, TimeOffset] = {}
        self._moved_s: dict[str, float] = {}
        #: Delays that explain why absolute estimates were outvoted, and when that was [s].
        self._delays_of_liars: dict[str, tuple[float, TimeOffset]] = {}
        self._told: set[str] = set()  # whose slow offset was warned of
        #: How long the errors of absolute poses last, as they were used last [s].
        self._lasting_s: dict[str, float] = {}

    def begin_anew(self) -> None:
        """Learn from now on, at any time; what is known stays."""
        self._offsets = self._offsets.begin_anew()
        self._correlations = self._correlations.begin_anew()
        if self._noise is not None:
            self._noise = self._noise.begin_anew()

    def noise_scales(self) -> Mapping[str, float]:
        """Return by which factor stated standard deviations are multiplied, by localizer; those at their word not."""
        return {} if self._noise is None else self._noise.scales()

    def correlation_times(self) -> Mapping[str, float]:
        """Return how long errors of absolute poses are found to last, by localizer; those that err anew not [s]."""
        return self._correlations.times()

    def clock_offsets(self) -> Mapping[str, TimeOffset]:
        """Return how late or early stamps are found to be, by localizer; nothing where that is not certain."""
        of_liars = {source: found for source, (_, found) in self._delays_of_liars.items()}
        return {**of_liars, **self._slow_offsets, **self._offsets.certain}

    def on_one_clock(self, source: str, estimate: Estimate, timeline: Timeline) -> tuple[Estimate, float]:
        """Return a fix that is certainly late with the stamp that it should have, and by how much that is earlier [s].

        Liars are compared with nobody; but what lets absolute estimates lie may be a delay.
        """
        if self._offsets.is_due(estimate.stamp_s):
            for liar in outvoted_motions(timeline.state_at(math.inf)):
                self._offsets.forget(liar)
        self._offsets.note(source, estimate)
        if isinstance(estimate, Fix):
            self._hear_of_delay(source, timeline.state_at(math.inf))
        offset = self.clock_offsets().get(source)
        # Motion keeps its stamps: it would overlap with, or leave gaps to, what the same localizer told before. And a
        # belief that is moved by a fix from the future runs ahead of its frames.
        is_used = self._config.clock_offsets == "use" and isinstance(estimate, Fix)
        if not is_used or offset is None or offset.late_s < 0.0:
            self._moved_s.pop(source, None)
            return estimate, 0.0
        self._moved_s[source] = offset.late_s
        self._counted["stamps_corrected"] += 1
        return replace(estimate, stamp_s=estimate.stamp_s - offset.late_s), offset.late_s

    def moved_s(self, source: str) -> float:
        """Return by how much earlier the last fix of a localizer was put than it was stamped [s]."""
        return self._moved_s.get(source, 0.0)

    def _hear_of_delay(self, source: str, state: FilterState) -> None:
        """Take a delay that explains what a localizer was outvoted for; one that explains nothing any more goes."""
        fault = state.diagnosis.absolute_faults.get(source)
        since_s, found = self._delays_of_liars.get(source, (-math.inf, None))
        if fault is None or fault.since_s <= since_s:
            return
        if fault.late is None:
            self._delays_of_liars.pop(source, None)
            return
        late_s, sigma_s = fault.late
        late_s += self.moved_s(source)  # beside what was corrected until then
        self._delays_of_liars[source] = fault.since_s, TimeOffset("motion", late_s, sigma_s)
        if found is None and source not in self.clock_offsets().keys() - self._delays_of_liars.keys():
            warn_of_offset(source, self._delays_of_liars[source][1])

    def believed_of_motion(self, source: str, motion: Motion, information: Sym3) -> Sym3:
        """Take note of a motion, and return its information as it is believed."""
        return information if self._noise is None else self._noise.believed_of_motion(source, motion, information)

    def believed_of_fix(self, source: str, fix: Fix, information: Sym3, *, moved_s: float) -> Sym3:
        """Take note of an absolute pose whose stamp was moved, and return its information as it is believed."""
        if self._noise is None:
            return information
        as_told = replace(fix, stamp_s=fix.stamp_s + moved_s) if moved_s else fix
        return self._noise.believed_of_fix(source, as_told, information)

    def compare_when_due(self, stamp_s: float, timeline: Timeline) -> None:
        """Compare what was said of the same motion, now and then, and move the scales of those that err by more."""
        if self._noise is None or not self._noise.is_due(stamp_s):
            return
        state = timeline.state_at(math.inf)
        corrected = None
        if state.gaussian is not None and not self._explains_corrections():
            corrected = state.diagnosis.corrections, state.diagnosis.correction_covariance
        accused = accused_sources(state, self._config.recover_after)
        self._noise.compare(stamp_s, accused, corrected, self._lasting_s)
        self.follow_delays(self._noise.delays(), outvoted_motions(state))

    def _explains_corrections(self) -> bool:
        """Return whether a belief that is corrected to one side for seconds may be no fault of the motion."""
        delays = {} if self._noise is None else self._noise.delays()
        is_late = any(
            abs(found.late_s - self._moved_s.get(source, 0.0)) > max(TOLD_S, _LIKELY * found.sigma_s)
            for source, found in delays.items()
        )
        return is_late or self._correlations.explains_corrections

    def follow_delays(self, delays: Mapping[str, TimeOffset], liars: Collection[str]) -> None:
        """Take the delays of poses that are certain by now, and let go of those of liars and that are unlikely now."""
        if self._config.clock_offsets == "off":
            return
        for source, found in delays.items():
            sure = _SURE_OF_LASTING if self._lasting_s.get(source, 0.0) > 0.0 else _SURE
            sigmas = _STILL_SURE if source in self._slow_offsets else sure
            if source in liars or abs(found.late_s) <= max(TOLD_S, sigmas * found.sigma_s):
                self._slow_offsets.pop(source, None)
                continue
            self._slow_offsets[source] = found
            if source not in self._told and source not in self._offsets.certain:
                self._told.add(source)
                warn_of_offset(source, found)

    def correlation_s(self, source: str, fix: Fix, trust: Trust) -> tuple[float, bool]:
        """Return how long the errors of an absolute pose last, and whether that is to be learned from it [s]."""
        stated_s = fix.correlation_s if trust.correlation_s is None else trust.correlation_s
        lasting_s = self._correlations.correlation_s(source) if stated_s is None else stated_s
        self._lasting_s[source] = lasting_s
        return lasting_s, stated_s is None and self._config.learn_correlations

    def observe(self, source: str, state: FilterState, verdict: Verdict) -> None:
        """Take note of the innovation of an absolute pose, unless it is open who is right."""
        if verdict.seen is not None and verdict.used is not None and not state.diagnosis.rivals:
            self._correlations.observe(source, state.stamp_s, verdict.seen, verdict.used)

    def add_to_health(self, health: dict[str, str]) -> None:
        """Add in words what was found of localizers that are well otherwise."""
        for source, offset in self.clock_offsets().items():
            health.setdefault(source, str(offset))
        for source, scale in self.noise_scales().items():
            health.setdefault(source, told_scale(scale))
