"""Counts of everything that happened to frames and estimates, by dotted name."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["Counters"]


class Counters:
    """Counts by dotted name, such as ``localizer.floor.late``; nothing is dropped without one."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}

    def add(self, name: str, n: int = 1) -> None:
        """Count `n` more of something."""
        self._counts[name] = self._counts.get(name, 0) + n

    def __getitem__(self, name: str) -> int:
        return self._counts.get(name, 0)

    def merged(self, others: Mapping[str, Mapping[str, int]]) -> dict[str, int]:
        """Return all counts, sorted, with what parts counted themselves below their own prefix."""
        counts = dict(self._counts)
        for prefix, own in others.items():
            for name, n in own.items():
                key = f"{prefix}.{name}"
                counts[key] = counts.get(key, 0) + n
        return dict(sorted(counts.items()))
