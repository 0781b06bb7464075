"""Puts the readings of several sensors in the order of their stamps."""

from __future__ import annotations

import heapq
import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from typing import Generic, Protocol, TypeVar

__all__ = ["MAX_HELD", "ReorderWindow", "in_stamp_order"]

#: Readings held back at most: unsynchronised clocks must not fill the memory.
MAX_HELD = 1000


class Stamped(Protocol):
    """Anything with a sensor and a stamp."""

    @property
    def sensor(self) -> str:
        """Name of the sensor."""

    @property
    def stamp_s(self) -> float:
        """When it was taken [s]."""


StampedT = TypeVar("StampedT", bound=Stamped)


class ReorderWindow(Generic[StampedT]):
    """Takes readings as they come and gives them by stamp; those of one sensor increase, one sensor may lag.

    A reading is released when every sensor has one waiting (nothing earlier can come then), or when it lies more
    than the window behind the newest one, or when `MAX_HELD` are waiting. What comes later than that is released out
    of order: the caller sees it by its stamp. Readings of equal stamp keep their order.

    Parameters
    ----------
    sensors : collection of str
        The sensors that give readings.
    window_s : float
        How far a sensor may lag [s].
    """

    def __init__(self, sensors: Collection[str], window_s: float) -> None:
        self._sensors, self._window_s = frozenset(sensors), window_s
        self._heap: list[tuple[float, int, StampedT]] = []
        self._waiting: Counter[str] = Counter()
        self._n_silent = len(self._sensors)  # of them, those of which nothing waits
        self._newest_s = -math.inf
        self._n_taken = 0

    def push(self, reading: StampedT) -> Iterator[StampedT]:
        """Take a reading, and yield those that need not wait any longer."""
        heapq.heappush(self._heap, (reading.stamp_s, self._n_taken, reading))
        self._n_taken += 1
        n_waiting = self._waiting[reading.sensor]
        self._waiting[reading.sensor] = n_waiting + 1
        if not n_waiting and reading.sensor in self._sensors:
            self._n_silent -= 1
        self._newest_s = max(self._newest_s, reading.stamp_s)
        while self._heap and self._is_due():
            yield self._pop()

    def flush(self) -> Iterator[StampedT]:
        """Yield all that wait."""
        while self._heap:
            yield self._pop()

    def _is_due(self) -> bool:
        return not self._n_silent or self._newest_s - self._heap[0][0] > self._window_s or len(self._heap) > MAX_HELD

    def _pop(self) -> StampedT:
        oldest = heapq.heappop(self._heap)[2]
        n_waiting = self._waiting[oldest.sensor] = self._waiting[oldest.sensor] - 1
        if not n_waiting and oldest.sensor in self._sensors:
            self._n_silent += 1
        return oldest


def in_stamp_order(readings: Iterable[StampedT], sensors: Collection[str], window_s: float) -> Iterator[StampedT]:
    """Yield the readings of a recording by stamp, as `ReorderWindow` gives them.

    Parameters
    ----------
    readings : iterable of StampedT
        Readings as the recording has them.
    sensors : collection of str
        Names of all sensors of the recording.
    window_s : float
        How far one sensor may lag behind the others [s].

    Returns
    -------
    iterator of readings
        The readings, stamps not decreasing.
    """
    if len(sensors) <= 1:
        yield from readings
        return
    window: ReorderWindow[StampedT] = ReorderWindow(sensors, window_s)
    for reading in readings:
        yield from window.push(reading)
    yield from window.flush()
