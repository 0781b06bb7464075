"""What is learned of the localizers beside the state: their clocks, how wrong they are, and how long errors last."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

from trailmark.estimates import Estimate, Fix, Motion
from trailmark.estimation.kalman.clock_offsets import ClockOffsets, TimeOffset
from trailmark.estimation.kalman.correlation_times import CorrelationTimes
from trailmark.estimation.kalman.fault_detection import accused_sources, outvoted_motions
from trailmark.estimation.kalman.noise_scales import NoiseScales, told_scale
from trailmark.estimation.kalman.state import FilterState, Verdict
from trailmark.estimation.kalman.timeline import Timeline
from trailmark.estimation.kalman.trust import Trust
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.symmetric import Sym3

__all__ = ["SourceLearning"]


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
        return self._offsets.certain

    def on_one_clock(self, source: str, estimate: Estimate, timeline: Timeline) -> Estimate:
        """Return a fix that is certainly late with the stamp that it should have; liars are compared with nobody."""
        if self._offsets.is_due(estimate.stamp_s):
            for liar in outvoted_motions(timeline.state_at(math.inf)):
                self._offsets.forget(liar)
        corrected = self._offsets.on_one_clock(source, estimate)
        if self._config.clock_offsets != "use" or corrected is estimate:
            return estimate
        self._counted["stamps_corrected"] += 1
        return corrected

    def believed_of_motion(self, source: str, motion: Motion, information: Sym3) -> Sym3:
        """Take note of a motion, and return its information as it is believed."""
        return information if self._noise is None else self._noise.believed_of_motion(source, motion, information)

    def believed_of_fix(self, source: str, fix: Fix, information: Sym3) -> Sym3:
        """Take note of an absolute pose, and return its information as it is believed."""
        return information if self._noise is None else self._noise.believed_of_fix(source, fix, information)

    def compare_when_due(self, stamp_s: float, timeline: Timeline) -> None:
        """Compare what was said of the same motion, now and then, and move the scales of those that err by more."""
        if self._noise is None or not self._noise.is_due(stamp_s):
            return
        state = timeline.state_at(math.inf)
        corrected = None
        if state.gaussian is not None and not self._correlations.explains_corrections:
            corrected = state.diagnosis.corrections, state.diagnosis.correction_covariance
        self._noise.compare(stamp_s, accused_sources(state, self._config.recover_after), corrected)

    def correlation_s(self, source: str, fix: Fix, trust: Trust) -> tuple[float, bool]:
        """Return how long the errors of an absolute pose last, and whether that is to be learned from it [s]."""
        stated_s = fix.correlation_s if trust.correlation_s is None else trust.correlation_s
        if stated_s is not None:
            return stated_s, False
        return self._correlations.correlation_s(source), self._config.learn_correlations

    def observe(self, source: str, state: FilterState, verdict: Verdict) -> None:
        """Take note of the innovation of an absolute pose, unless it is open who is right."""
        if verdict.seen is not None and verdict.used is not None and not state.diagnosis.rivals:
            self._correlations.observe(source, state.stamp_s, verdict.seen, verdict.used)

    def add_to_health(self, health: dict[str, str]) -> None:
        """Add in words what was found of localizers that are well otherwise."""
        for source, offset in self._offsets.certain.items():
            health.setdefault(source, str(offset))
        for source, scale in self.noise_scales().items():
            health.setdefault(source, told_scale(scale))
