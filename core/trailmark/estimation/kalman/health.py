"""What is wrong with each localizer, in words."""

from __future__ import annotations

import math
from collections.abc import Mapping

from trailmark.estimates import Motion
from trailmark.estimation.kalman.bank import posterior
from trailmark.estimation.kalman.certainty import CertaintyRecord
from trailmark.estimation.kalman.moved_belief import reason_of_moved, source_of_moved
from trailmark.estimation.kalman.repeated_fixes import FROZEN, MOVES_ALONE, frozen_sources
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.kalman.trust import Trust
from trailmark.estimation.kalman.way_errors import reason_of_way_errors
from trailmark.estimation.kalman.windows import LONGEST_S
from trailmark.estimation.symmetric import Sym3
from trailmark.estimation.unmeasured import describe, longest

__all__ = ["SourceMonitor", "health_of"]

# Two refusals can be chance.
_REFUSED_OFTEN = 3
# No sensor observes twice within this [s].
_MOMENT_S = 0.005
# What turns on the spot goes as far as its wheels [m].
_LEVER_M = 0.3
# What moves no faster is at rest, but for noise [m/s].
_AT_REST_MPS = 0.02
# A question that absolute estimates decide, or a third motion, is decided sooner [s].
_UNDECIDED_S = 2.0
# Less probable hypotheses accuse nobody.
_PROBABLE = 0.02
_NOTHING_DECIDES = "its motion and that of others disagree, and nothing decides who is right"
_NOT_YET_DECIDED = (
    "its motion and what others say contradict each other: absolute estimates are heard, and do not decide yet who is"
    " right"
)
_NEVER_DECIDED = (
    "its motion and that of others disagreed, and nothing has decided since who was right: the belief covers both"
)


class SourceMonitor:
    """Arrivals and refusals of one localizer.

    Parameters
    ----------
    trust : Trust
        How its estimates are taken.

    Attributes
    ----------
    last_s : float
        Newest stamp of what was not refused; `Lost` counts; ``-inf`` before the first [s].
    n_refused : int
        Refusals in a row.
    refusal : str
        Reason of the last one.
    fix_certainty, motion_certainty : CertaintyRecord
        How certain its absolute estimates and its motion have been.
    """

    __slots__ = (
        "_last_key",
        "_last_key_s",
        "fix_certainty",
        "last_s",
        "motion_certainty",
        "n_refused",
        "refusal",
        "trust",
    )

    def __init__(self, trust: Trust) -> None:
        self.trust = trust
        self.last_s = -math.inf
        self.n_refused = 0
        self.refusal = ""
        self.fix_certainty, self.motion_certainty = CertaintyRecord(), CertaintyRecord()
        self._last_key: tuple[str, tuple[float, ...]] | None = None
        self._last_key_s = -math.inf

    def is_repetition(self, key: tuple[str, tuple[float, ...]], stamp_s: float) -> bool:
        """Return whether an absolute estimate is, to the last bit, the one before it a moment ago."""
        is_same = key == self._last_key and 0.0 < abs(stamp_s - self._last_key_s) < _MOMENT_S
        if not is_same:
            self._last_key, self._last_key_s = key, stamp_s
        return is_same

    @property
    def is_too_certain(self) -> bool:
        """Whether what it states of its certainty is without precedent."""
        return max(self.fix_certainty.n_in_a_row, self.motion_certainty.n_in_a_row) >= _REFUSED_OFTEN

    def believed_of_motion(self, motion: Motion, information: Sym3) -> Sym3:
        """Return the information of a motion as it is believed: of a short one there is less to be uncertain of."""
        step = motion.pose_since_now
        way_m = math.hypot(step.x, step.y)
        moved_m = way_m, way_m + _LEVER_M * abs(step.theta)
        at_rest_m = _AT_REST_MPS * (motion.stamp_s - motion.since_s)
        lengths = moved_m[0] if moved_m[0] > at_rest_m else 0.0, moved_m[1] if moved_m[1] > at_rest_m else 0.0
        return self.motion_certainty.believed(information, motion.stamp_s, lengths)

    def record_refusal(self, reason: str) -> None:
        """Count an estimate that was refused."""
        self.n_refused += 1
        self.refusal = reason

    def record_arrival(self, stamp_s: float) -> None:
        """Take note of an estimate that was not refused."""
        self.n_refused = 0
        if stamp_s > self.last_s:
            self.last_s = stamp_s

    def restart_clock(self, stamp_s: float) -> None:
        """Count silence from the first stamp of a clock that was set."""
        if self.last_s > -math.inf:
            self.last_s = stamp_s
        self.fix_certainty.restart_clock(stamp_s)
        self.motion_certainty.restart_clock(stamp_s)


def health_of(monitors: Mapping[str, SourceMonitor], state: FilterState, recover_after: int) -> dict[str, str]:
    """Return what is wrong, by localizer; nothing for one that is well."""
    health: dict[str, str] = {}
    undecided = _undecided_of(state)
    doubts = {s: one for s, one in state.diagnosis.doubts.items() if state.stamp_s - one.since_s > _UNDECIDED_S}
    moved_for = source_of_moved(state)
    unmeasured_s = longest(state.odometry.unmeasured_s)
    frozen = frozen_sources(state)
    for source, monitor in monitors.items():
        n_rejected = state.rejections.counts.get(source, 0)
        fault = state.diagnosis.faults.get(source) or state.diagnosis.absolute_faults.get(source)
        if source in frozen:
            health[source] = FROZEN
        elif fault is not None:
            health[source] = fault.reason
        elif source in undecided:
            health[source] = undecided[source]
        elif monitor.n_refused >= _REFUSED_OFTEN:
            health[source] = f"refused {monitor.n_refused} in a row: {monitor.refusal}"
        elif n_rejected and _is_contradiction(state, n_rejected, recover_after) and source not in _asked_about(state):
            health[source] = f"contradicts the belief, {n_rejected} of late"
        elif source == moved_for:
            health[source] = reason_of_moved(state)
        elif monitor.is_too_certain:
            health[source] = "far more certain than it ever was: not believed to be"
        elif source in doubts:
            health[source] = str(doubts[source])
        elif source in state.diagnosis.sums and any(state.diagnosis.way_errors):
            health[source] = reason_of_way_errors(state.diagnosis.way_errors)
        elif source in state.diagnosis.sums and any(frozen.values()):
            health[source] = MOVES_ALONE
        elif source in state.diagnosis.parting.told:
            health[source] = state.diagnosis.parting.told[source]
        elif source in state.left_out:
            health[source] = "its motion contradicts the others and the velocity before"
        elif state.stamp_s - monitor.last_s > monitor.trust.timeout_s:
            silence_s = state.stamp_s - monitor.last_s
            health[source] = f"silent for {silence_s:.1f} s" if silence_s < math.inf else "not heard of yet"
        elif source in state.diagnosis.sums and unmeasured_s > monitor.trust.timeout_s:
            health[source] = describe(state.odometry.unmeasured_s, state.odometry.pose_odom_base.theta, unmeasured_s)
    return health


def _is_contradiction(state: FilterState, n_rejected: int, recover_after: int) -> bool:
    """Return whether refused absolute estimates are worth a word: each is, where none has fitted for long."""
    agreed_s = max((one.stamp_s for one in state.rejections.corroborations.values()), default=-math.inf)
    return n_rejected >= recover_after or state.stamp_s - agreed_s > LONGEST_S


def _asked_about(state: FilterState) -> set[str]:
    """Return the localizers whose absolute estimates a question is about: while it is young nobody is accused."""
    if state.stamp_s - state.diagnosis.undecided_since_s > _UNDECIDED_S:
        return set()
    return {source for rival in state.diagnosis.rivals for source in rival.state.diagnosis.absolute_faults}


def _undecided_of(state: FilterState) -> dict[str, str]:
    """Return who may be wrong, and why that is not decided; nobody while a question is young."""
    accused = state.diagnosis.accused
    undecided = dict.fromkeys(sorted(accused), _NEVER_DECIDED)
    if state.stamp_s - state.diagnosis.undecided_since_s <= _UNDECIDED_S:
        return undecided
    rivals = state.diagnosis.rivals
    for rival, probability in zip(rivals, posterior(rivals)):
        if probability < _PROBABLE:
            continue
        for source in rival.state.diagnosis.faults:
            undecided.setdefault(source, _NOT_YET_DECIDED if rival.n_measurements else _NOTHING_DECIDES)
        for source, fault in rival.state.diagnosis.absolute_faults.items():
            undecided.setdefault(source, fault.reason)
    return undecided
