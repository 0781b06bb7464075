"""What each localizer has been worth of late: when it was heard, and how often it contradicted the belief."""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Mapping

__all__ = ["SourceRecord", "contradiction_of", "health_of"]

# Two contradictions can be chance.
_OFTEN = 3
_REMEMBERED = 10


class SourceRecord:
    """Arrivals, refusals and contradictions of one localizer.

    Attributes
    ----------
    last_s : float
        Newest stamp of what was not refused [s].
    n_refused, refusal : int, str
        Refusals in a row, and the reason of the last.
    n_rejected : int
        How many more absolute estimates were rejected than accepted, of late.
    accepted_s : float
        Stamp of the last absolute estimate that was accepted [s].
    """

    __slots__ = ("_ratios", "accepted_s", "last_s", "n_refused", "n_rejected", "refusal")

    def __init__(self) -> None:
        self.last_s = self.accepted_s = -math.inf
        self.n_refused = self.n_rejected = 0
        self.refusal = ""
        self._ratios: deque[float] = deque(maxlen=_REMEMBERED)

    @property
    def contradicts(self) -> bool:
        """Whether it has contradicted the belief so often that this is no chance."""
        return self.n_rejected >= _OFTEN

    @property
    def distance(self) -> float:
        """By which factor its rejected estimates are further off than variances say, in the middle."""
        return statistics.median(self._ratios) if self._ratios else 1.0

    def record_refusal(self, reason: str) -> None:
        """Count an estimate that was refused."""
        self.n_refused += 1
        self.refusal = reason

    def record_arrival(self, stamp_s: float) -> None:
        """Take note of an estimate that was not refused."""
        self.n_refused = 0
        self.last_s = max(self.last_s, stamp_s)

    def record_verdict(self, stamp_s: float, is_accepted: bool, ratio: float) -> None:
        """Count an absolute estimate; `ratio` is its NIS per degree of freedom."""
        if is_accepted:
            self.accepted_s = max(self.accepted_s, stamp_s)
            self.n_rejected = max(0, self.n_rejected - 1)
        else:
            self.n_rejected += 1
            self._ratios.append(ratio)

    def restart_clock(self, stamp_s: float) -> None:
        """Count silence from the first stamp of a clock that was set; what was accepted before it supports nothing."""
        if self.last_s > -math.inf:
            self.last_s = stamp_s
        self.accepted_s = -math.inf

    def forgive(self) -> None:
        """Forget what was rejected: the belief was wrong, not the localizer."""
        self.n_rejected = 0
        self._ratios.clear()


def contradiction_of(records: Mapping[str, SourceRecord], now_s: float, support_s: float) -> float:
    """Return by which factor the covariance of a belief is too small that localizers contradict and none supports.

    1 where all is well, or another localizer was accepted within `support_s`.
    """
    against = [record for record in records.values() if record.contradicts]
    if not against:
        return 1.0
    if any(now_s - record.accepted_s < support_s for record in records.values() if not record.contradicts):
        return 1.0
    return max(1.0, *(record.distance for record in against))


def health_of(records: Mapping[str, SourceRecord], now_s: float, timeout_s: float) -> dict[str, str]:
    """Return what is wrong, by localizer; nothing for one that is well."""
    health = {}
    for source, record in records.items():
        if record.n_refused >= _OFTEN:
            health[source] = f"refused {record.n_refused} in a row: {record.refusal}"
        elif record.contradicts:
            health[source] = f"contradicts the belief, {record.n_rejected} of late"
        elif now_s - record.last_s > timeout_s:
            silence_s = now_s - record.last_s
            health[source] = f"silent for {silence_s:.1f} s" if silence_s < math.inf else "not heard of yet"
    return health
