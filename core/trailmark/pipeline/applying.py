"""Giving estimates to the estimator: those it uses, once each, counted and told."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from time import perf_counter_ns

from trailmark.errors import ConfigError, RunError
from trailmark.estimates import Applied, Belief, Estimate, Lost, Motion
from trailmark.pipeline.counters import Counters
from trailmark.pipeline.observing import Answer
from trailmark.pipeline.plan import Plan, PlannedLocalizer
from trailmark.pipeline.steps import Told
from trailmark.pipeline.telling import Telling
from trailmark.pipeline.timing import StageTimes

__all__ = ["Applying"]

logger = logging.getLogger(__name__)

# Stamps that went through decimals differ by this from the frame's.
_SLACK_S = 1e-6

_NOT_IN_USE = Applied("unused", "not in the estimator's 'use'")


class Applying:
    """The estimator of a run, and the rules that hold for every estimator.

    An estimate of a localizer that is not in ``use`` is ``unused``; one about an instant after its frame is
    ``refused``; a second localizer that gives `Motion` of the same sensor (or, if the estimator integrates one only,
    any second one) is an error unless ``use`` says that both are meant.
    """

    def __init__(self, plan: Plan, counters: Counters, times: StageTimes, telling: Telling) -> None:
        self._estimator = plan.estimator
        self._use = plan.use
        self._counters = counters
        self._times = times.stage("estimator")
        self._telling = telling
        self._moving: dict[str, PlannedLocalizer] = {}
        #: What a belief says about the health of localizers, besides what the estimator says.
        self.health: dict[str, str] = {}

    def apply(self, planned: PlannedLocalizer, answers: Sequence[Answer]) -> list[Told]:
        """Apply what a localizer has answered and return what became of it.

        Raises
        ------
        ConfigError
            If its motion would count twice.
        RunError
            If the estimator raises.
        """
        everything = []
        for answer in answers:
            for estimate in answer.estimates:
                told = Told(answer.arrived_s, planned.name, estimate, self._applied(planned, estimate, answer.frame_s))
                self._count(told)
                self._telling.told(told)
                everything.append(told)
        return everything

    def belief(self, stamp_s: float | None = None) -> Belief:
        """Return the belief at a stamp.

        Raises
        ------
        RunError
            If the estimator raises.
        """
        began_ns = perf_counter_ns()
        try:
            belief = self._estimator.belief(stamp_s)
        except Exception as error:
            raise _failed("belief", error) from error
        self._times.append(perf_counter_ns() - began_ns)
        return replace(belief, health={**belief.health, **self.health}) if self.health else belief

    def _applied(self, planned: PlannedLocalizer, estimate: Estimate, frame_s: float) -> Applied:
        if self._use is not None and planned.name not in self._use:
            return _NOT_IN_USE
        if estimate.stamp_s > frame_s + _SLACK_S:
            return Applied("refused", f"about {estimate.stamp_s:.6f} s, but its frame is of {frame_s:.6f} s")
        if isinstance(estimate, Motion) and planned.name not in self._moving:
            self._admit_motion(planned)
        began_ns = perf_counter_ns()
        try:
            applied = self._estimator.apply(planned.name, estimate)
        except Exception as error:
            raise _failed(f"{type(estimate).__name__} of {planned.name!r}", error) from error
        self._times.append(perf_counter_ns() - began_ns)
        return applied

    def _admit_motion(self, planned: PlannedLocalizer) -> None:
        for other in self._moving.values() if self._use is None else ():
            shared = other.sensors & planned.sensors
            if shared or self._estimator.takes_one_motion:
                why = f"of the sensor {min(shared)!r}" if shared else "and the estimator takes it from one"
                raise ConfigError(
                    f"{other.name!r} and {planned.name!r} both give motion {why}: 10 m would become 20. Say which"
                    f" counts with estimator: {{use: [{other.name}]}}, or choose an estimator that weighs them"
                )
        self._moving[planned.name] = planned

    def _count(self, told: Told) -> None:
        prefix = f"localizer.{told.source}."
        self._counters.add(prefix + told.applied.status)
        if isinstance(told.estimate, Lost):
            self._counters.add(prefix + "lost")


def _failed(what: str, error: Exception) -> RunError:
    return RunError(f"the estimator failed at {what}: {type(error).__name__}: {error}", "estimator")
