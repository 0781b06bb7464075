"""Keeping few of many, evenly, while more come."""

from __future__ import annotations

from typing import Generic, TypeVar

import numpy as np

from trailmark.geometry import Trajectory

__all__ = ["Thinned", "every_nth"]

T = TypeVar("T")


class Thinned(Generic[T]):
    """Keeps between half of a number and that number of items, evenly over all that came, and always the newest.

    Parameters
    ----------
    limit : int
        How many.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._stride = 1
        self._n_seen = 0
        self._has_odd_last = False
        self.kept: list[T] = []

    def add(self, item: T) -> list[T]:
        """Take an item; return those that are let go for it."""
        gone = [self.kept.pop()] if self._has_odd_last else []
        self._has_odd_last = self._n_seen % self._stride != 0
        self._n_seen += 1
        self.kept.append(item)
        if len(self.kept) > self._limit:
            last = len(self.kept) - 1
            self._has_odd_last |= last % 2 == 1
            gone += [kept for i, kept in enumerate(self.kept) if i % 2 and i != last]
            self.kept = [kept for i, kept in enumerate(self.kept) if i % 2 == 0 or i == last]
            self._stride *= 2
        return gone


def every_nth(way: Trajectory, limit: int) -> Trajectory:
    """Return a trajectory with at most so many poses, evenly taken, the newest among them."""
    if len(way) <= limit:
        return way
    kept = np.linspace(0, len(way) - 1, limit).round().astype(np.intp)
    return Trajectory(way.stamps_s[kept], way.poses[kept])
