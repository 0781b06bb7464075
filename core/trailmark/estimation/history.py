"""A bounded history of measurements: what came late is inserted where it belongs, and what followed is replayed.

An estimator is a pure step function, ``state' = step(state, stamp_s, measurement)``. Its history keeps the
measurements of a window of time in the order of their stamps, each with a snapshot of the state after it, so the
state is always what it would be had everything come in order::

    history = History(span_s=10.0, step=my_step, initial=State())
    state = history.insert(stamp_s, measurement)      # None: older than the window
    state = history.state_at(stamp_s)                 # then predict from it to stamp_s

A filter of its own makes `step` predict to the stamp and update there, and lets the state carry what came of it
(its innovation, whether it was gated), so that ``history.insert`` hands that back too. Later states are replayed when
they are asked for: measurements that come late together are replayed once.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable
from typing import Generic, TypeVar

__all__ = ["History"]

M = TypeVar("M")
S = TypeVar("S")


class History(Generic[M, S]):
    """Measurements of the last `span_s` seconds, and the state after each of them.

    Measurements of one stamp stand in the order in which they arrived.

    Parameters
    ----------
    span_s : float
        Length of the window: how much later than the newest a measurement may come [s].
    step : callable
        ``step(state, stamp_s, measurement)`` returns the state after a measurement. It must not change the state
        that it is given: states are the snapshots.
    initial : S
        The state before the first measurement.

    Attributes
    ----------
    newest_s : float
        The newest stamp heard of; ``-inf`` before the first [s].
    horizon_s : float
        The beginning of the window: what is older comes too late [s].
    last_stamp_s : float
        Stamp of the newest measurement in the window; ``-inf`` if there is none [s].
    """

    def __init__(self, span_s: float, step: Callable[[S, float, M], S], initial: S) -> None:
        self._span_s = span_s
        self._step = step
        self._before = initial  # the state at the beginning of the window
        self._stamps: list[float] = []
        self._measurements: list[M] = []
        self._states: list[S] = []  # after the first measurements; those after the others are not known yet
        self.newest_s = -math.inf
        self.horizon_s = -math.inf
        self.last_stamp_s = -math.inf

    def __len__(self) -> int:
        return len(self._stamps)

    def advance(self, stamp_s: float) -> None:
        """Move the end of the window to `stamp_s`, unless it ends later; what falls out is forgotten."""
        if stamp_s <= self.newest_s:
            return
        self.newest_s, self.horizon_s = stamp_s, stamp_s - self._span_s
        if self._stamps and self._stamps[0] < self.horizon_s:
            n_old = bisect_left(self._stamps, self.horizon_s)
            self._before = self._state_after(n_old)
            del self._stamps[:n_old], self._measurements[:n_old], self._states[:n_old]
            self.last_stamp_s = self._stamps[-1] if self._stamps else -math.inf

    def insert(self, stamp_s: float, measurement: M) -> S | None:
        """Put a measurement where it belongs; what follows it is replayed when it is asked for.

        Returns
        -------
        S or None
            The state right after the measurement; None if its stamp lies before the window.
        """
        if stamp_s < self.horizon_s:
            return None
        self.advance(stamp_s)
        index = bisect_right(self._stamps, stamp_s)
        self._stamps.insert(index, stamp_s)
        self._measurements.insert(index, measurement)
        self.last_stamp_s = self._stamps[-1]
        del self._states[index:]
        return self._state_after(index + 1)

    def replay(self, since_s: float) -> None:
        """Do all measurements later than `since_s` again: something that `step` looks at has changed there."""
        del self._states[bisect_right(self._stamps, since_s) :]

    def state_at(self, stamp_s: float) -> S:
        """Return the state after the last measurement at or before a stamp."""
        return self._state_after(bisect_right(self._stamps, stamp_s))

    def _state_after(self, n: int) -> S:
        """Return the state after the first n measurements of the window."""
        states = self._states
        if n > len(states):
            state = states[-1] if states else self._before
            for i in range(len(states), n):
                state = self._step(state, self._stamps[i], self._measurements[i])
                states.append(state)
        return states[n - 1] if n else self._before
