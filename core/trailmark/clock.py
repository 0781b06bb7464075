"""Clocks: that of live stamps, and that by which a run in real time waits."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod

__all__ = ["Clock", "RunClock", "SystemClock", "live_stamp_s"]

# Anchored once: a clock that is set while the robot drives must not move its stamps.
_EPOCH_S = time.time() - time.monotonic()


def live_stamp_s() -> float:
    """Return now as live sources stamp their frames: the monotonic clock, anchored once to the epoch [s]."""
    return _EPOCH_S + time.monotonic()


class Clock(ABC):
    """Gives stamps and waits; a test passes a clock of its own."""

    @abstractmethod
    def now_s(self) -> float:
        """Return the time; it never goes back [s]."""

    @abstractmethod
    def wait(self, timeout_s: float, wake: threading.Event) -> None:
        """Return after `timeout_s` (``inf``: not by itself), or as soon as `wake` is set."""


class SystemClock(Clock):
    """The clock of live stamps."""

    # An endless wait would not hear Ctrl-C on every system.
    _LONGEST_WAIT_S = 0.5

    def now_s(self) -> float:
        """Return `live_stamp_s`."""
        return live_stamp_s()

    def wait(self, timeout_s: float, wake: threading.Event) -> None:
        """Wait for the event."""
        wake.wait(max(0.0, min(timeout_s, self._LONGEST_WAIT_S)))


class RunClock:
    """The time of a run in real time: the clock's, moved so that the first recorded frame is on time.

    Parameters
    ----------
    clock : Clock
        The clock of the machine, or a test's.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._offset_s = 0.0
        self._is_waiting = False
        self._alive_s = time.monotonic()
        #: Set when something has happened that a waiting run should look at.
        self.wake = threading.Event()

    def anchor(self, stamp_s: float) -> None:
        """Set the time to `stamp_s` now."""
        self._offset_s = stamp_s - self._clock.now_s()

    def now_s(self) -> float:
        """Return the time in the clock of the frames [s]."""
        return self._clock.now_s() + self._offset_s

    def wait(self, until_s: float) -> None:
        """Return at `until_s`, or earlier when woken."""
        self._is_waiting = True
        try:
            self._clock.wait(until_s - self.now_s(), self.wake)
        finally:
            self.beat()
            self._is_waiting = False
        self.wake.clear()

    def beat(self) -> None:
        """Take note that the run's loop lives."""
        self._alive_s = time.monotonic()

    def quiet_s(self) -> float:
        """Return for how long the loop has neither lived nor waited for what comes next; from any thread [s]."""
        return 0.0 if self._is_waiting else time.monotonic() - self._alive_s
