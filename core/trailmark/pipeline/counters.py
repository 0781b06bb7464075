"""Counts of everything that happened to frames and estimates, by dotted name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

__all__ = ["Counters"]


class Counters(Counter[str]):
    """Counts by dotted name, such as ``localizer.floor.late``; nothing is dropped without one."""

    def add(self, name: str, n: int = 1) -> None:
        """Count `n` more of something."""
        self[name] += n

    def merged(self, others: Mapping[str, Mapping[str, int]]) -> dict[str, int]:
        """Return all counts, sorted, with what parts counted themselves below their own prefix."""
        counts = Counter(self)
        for prefix, own in others.items():
            counts.update({f"{prefix}.{name}": n for name, n in own.items()})
        return dict(sorted(counts.items()))
