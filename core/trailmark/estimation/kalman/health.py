"""What is worth a word about each localizer."""

from __future__ import annotations

from collections.abc import Mapping

from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.kalman.trust import Trust

__all__ = ["Listening", "health_of"]

# Two refusals can be chance.
_REFUSED_OFTEN = 3


class Listening:
    """What was heard of one localizer.

    Parameters
    ----------
    trust : Trust
        How its estimates are taken.
    """

    __slots__ = ("last_s", "n_refused", "refusal", "trust")

    def __init__(self, trust: Trust) -> None:
        self.trust = trust
        self.last_s = float("-inf")
        self.n_refused = 0
        self.refusal = ""

    def refused(self, reason: str) -> None:
        """An estimate was refused."""
        self.n_refused += 1
        self.refusal = reason

    def heard(self, stamp_s: float) -> None:
        """An estimate was taken; `Lost` counts as hearing too."""
        self.n_refused = 0
        if stamp_s > self.last_s:
            self.last_s = stamp_s


def health_of(listening: Mapping[str, Listening], state: FilterState, recover_after: int) -> dict[str, str]:
    """Return what is wrong, by localizer; nothing for one that is well."""
    health: dict[str, str] = {}
    for source, ear in listening.items():
        n_rejected = state.rejected.get(source, 0)
        if ear.n_refused >= _REFUSED_OFTEN:
            health[source] = f"refused {ear.n_refused} in a row: {ear.refusal}"
        elif n_rejected >= recover_after:
            health[source] = f"contradicts the belief, {n_rejected} of late"
        elif source in state.left_out:
            health[source] = "its motion contradicts the others and the velocity before"
        elif state.stamp_s - ear.last_s > ear.trust.timeout_s:
            silence_s = state.stamp_s - ear.last_s
            health[source] = f"silent for {silence_s:.1f} s" if silence_s < float("inf") else "not heard of yet"
    return health
