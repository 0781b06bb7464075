"""Live frames of several sensors in the order of their stamps, waiting no longer than each sensor needs."""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections import deque
from collections.abc import Callable, Mapping

from trailmark.frames import Frame

__all__ = ["StampOrder"]

# Frames of one sensor that may wait once they are due: of a picture the next to work on and the one that comes
# meanwhile; readings that add up (inertial ones) are kept, so that a pause of the program loses none of the motion.
_WAITING_SNAPSHOTS = 2
_WAITING_READINGS = 200

# How many frames a sensor's habits are learnt from.
_N_HABITS = 50

# Part of its usual interval before which a sensor is not expected to give its next frame.
_EARLIEST = 0.8

# Nobody waits for a sensor that has been silent for so many of its intervals, and for at least so long.
_SILENT_INTERVALS = 5.0
_SILENT_S = 0.5

# Added to the longest delay that was seen of a sensor: it need not have been the longest there is [s].
_MARGIN_S = 0.002


class StampOrder:
    """Holds live frames back until nothing earlier is expected of the other sensors.

    A frame waits for a sensor whose next frame, by its usual interval, may be earlier, but no longer than that sensor
    was late so far, and no longer than its window. So a camera that is 150 ms behind the odometry delays the
    odometry by 150 ms, and one that is not costs nothing. A frame that comes after a later one was given out is late:
    it is left out and counted. A sensor that falls silent is not waited for.

    Parameters
    ----------
    windows_s : mapping of str to float
        How long others wait for each sensor at most; a run without windows takes frames as they come [s].
    count : callable
        Called with ``(sensor, "late" | "dropped")`` for a frame that is left out.
    """

    def __init__(self, windows_s: Mapping[str, float], count: Callable[[str, str], None]) -> None:
        self._windows_s = windows_s
        self._is_ordered = any(window_s > 0.0 for window_s in windows_s.values())
        self._count = count
        self._held: dict[str, deque[tuple[Frame, float]]] = {}
        self._habits: dict[str, _Habits] = {}
        self._given_s = -math.inf

    def put(self, frame: Frame, now_s: float) -> None:
        """Take a frame that has come now; stamps of one sensor increase."""
        habits = self._habits.setdefault(frame.sensor, _Habits())
        habits.learn(frame.stamp_s, now_s)
        if self._is_ordered and frame.stamp_s < self._given_s:
            self._count(frame.sensor, "late")
            return
        held = self._held.setdefault(frame.sensor, deque())
        held.append((frame, now_s))
        limit = _WAITING_SNAPSHOTS if frame.payload.is_snapshot else _WAITING_READINGS
        if len(held) > limit and self._due_s(*held[0], now_s) <= now_s:
            held.popleft()
            self._count(frame.sensor, "dropped")

    def take(self, now_s: float) -> Frame | None:
        """Return the earliest frame if it need not wait any longer; `inf` asks for it whatever is expected."""
        held = self._earliest()
        if held is None or self._due_s(*held[0], now_s) > now_s:
            return None
        frame, _ = held.popleft()
        self._given_s = max(self._given_s, frame.stamp_s)
        return frame

    def due_s(self, now_s: float) -> float:
        """Return when to ask again, unless a frame comes first; `inf` while nothing waits [s]."""
        held = self._earliest()
        return math.inf if held is None else self._due_s(*held[0], now_s)

    def _earliest(self) -> deque[tuple[Frame, float]] | None:
        waiting = [held for held in self._held.values() if held]
        return min(waiting, key=lambda held: held[0][0].stamp_s, default=None)

    def _due_s(self, frame: Frame, came_s: float, now_s: float) -> float:
        due_s = came_s
        for sensor, window_s in self._windows_s.items():
            habits = self._habits.get(sensor)
            if sensor == frame.sensor or window_s <= 0.0 or habits is None:
                continue
            if habits.earliest_next_s > frame.stamp_s or habits.is_silent(now_s):
                continue
            due_s = max(due_s, min(frame.stamp_s + habits.longest_delay_s + _MARGIN_S, came_s + window_s))
        return due_s


class _Habits:
    """How often one sensor gives frames, and how long after their stamps they come."""

    def __init__(self) -> None:
        self._last_s = math.nan
        self._came_s = math.nan
        self._intervals_s, self._delays_s = _LastNumbers(), _LastNumbers()
        self._interval_s = 0.0
        self.longest_delay_s = 0.0

    def learn(self, stamp_s: float, came_s: float) -> None:
        """Take note of a frame."""
        if stamp_s > self._last_s:
            self._intervals_s.add(stamp_s - self._last_s)
            self._interval_s = self._intervals_s.median
        self._delays_s.add(came_s - stamp_s)
        self.longest_delay_s = self._delays_s.largest
        self._last_s, self._came_s = stamp_s, came_s

    @property
    def earliest_next_s(self) -> float:
        """The earliest stamp that the next frame may have."""
        return self._last_s + _EARLIEST * self._interval_s

    def is_silent(self, now_s: float) -> bool:
        """Return whether the next frame is long overdue."""
        return now_s - self._came_s > max(_SILENT_S, _SILENT_INTERVALS * self._interval_s)


class _LastNumbers:
    """The last `_N_HABITS` numbers, sorted as they come: each frame asks for their median."""

    def __init__(self) -> None:
        self._numbers: deque[float] = deque()
        self._sorted: list[float] = []

    def add(self, number: float) -> None:
        """Take a number, and forget the oldest."""
        if len(self._numbers) == _N_HABITS:
            del self._sorted[bisect_left(self._sorted, self._numbers.popleft())]
        self._numbers.append(number)
        insort(self._sorted, number)

    @property
    def median(self) -> float:
        """Their median."""
        middle = len(self._sorted) // 2
        if len(self._sorted) % 2:
            return self._sorted[middle]
        return (self._sorted[middle - 1] + self._sorted[middle]) / 2

    @property
    def largest(self) -> float:
        """The largest of them."""
        return self._sorted[-1]
