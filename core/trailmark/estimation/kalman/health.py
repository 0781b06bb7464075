"""What is wrong with each localizer, in words."""

from __future__ import annotations

import math
from collections.abc import Mapping

from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.kalman.trust import Trust

__all__ = ["SourceMonitor", "health_of"]

# Two refusals can be chance.
_REFUSED_OFTEN = 3
# No sensor observes twice within this [s].
_MOMENT_S = 0.005
# A question that absolute estimates decide is decided sooner [s].
_UNDECIDED_S = 2.0


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
    """

    __slots__ = ("_last_key", "_last_key_s", "last_s", "n_refused", "refusal", "trust")

    def __init__(self, trust: Trust) -> None:
        self.trust = trust
        self.last_s = -math.inf
        self.n_refused = 0
        self.refusal = ""
        self._last_key: tuple[str, tuple[float, ...]] | None = None
        self._last_key_s = -math.inf

    def is_repetition(self, key: tuple[str, tuple[float, ...]], stamp_s: float) -> bool:
        """Return whether an absolute estimate is, to the last bit, the one before it a moment ago."""
        is_same = key == self._last_key and 0.0 < abs(stamp_s - self._last_key_s) < _MOMENT_S
        if not is_same:
            self._last_key, self._last_key_s = key, stamp_s
        return is_same

    def record_refusal(self, reason: str) -> None:
        """Count an estimate that was refused."""
        self.n_refused += 1
        self.refusal = reason

    def record_arrival(self, stamp_s: float) -> None:
        """Take note of an estimate that was not refused."""
        self.n_refused = 0
        if stamp_s > self.last_s:
            self.last_s = stamp_s


def health_of(monitors: Mapping[str, SourceMonitor], state: FilterState, recover_after: int) -> dict[str, str]:
    """Return what is wrong, by localizer; nothing for one that is well."""
    health: dict[str, str] = {}
    for source, monitor in monitors.items():
        n_rejected = state.rejections.counts.get(source, 0)
        fault = state.consistency.faults.get(source)
        if fault is not None:
            health[source] = fault.reason
        elif monitor.n_refused >= _REFUSED_OFTEN:
            health[source] = f"refused {monitor.n_refused} in a row: {monitor.refusal}"
        elif n_rejected >= recover_after:
            health[source] = f"contradicts the belief, {n_rejected} of late"
        elif source in state.left_out:
            health[source] = "its motion contradicts the others and the velocity before"
        elif state.stamp_s - monitor.last_s > monitor.trust.timeout_s:
            silence_s = state.stamp_s - monitor.last_s
            health[source] = f"silent for {silence_s:.1f} s" if silence_s < math.inf else "not heard of yet"
    if state.stamp_s - state.consistency.undecided_since_s > _UNDECIDED_S:
        for rival in state.consistency.rivals:
            for source in rival.state.consistency.faults:
                health.setdefault(source, "its motion and that of others disagree, and nothing decides who is right")
    return health
