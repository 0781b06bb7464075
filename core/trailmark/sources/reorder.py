"""Puts the readings of several sensors in the order of their stamps."""

from __future__ import annotations

import heapq
import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from typing import Protocol, TypeVar

__all__ = ["MAX_HELD", "in_stamp_order"]

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


def in_stamp_order(readings: Iterable[StampedT], sensors: Collection[str], window_s: float) -> Iterator[StampedT]:
    """Yield readings by stamp; those of one sensor already increase, one sensor may lag behind another.

    A reading is released when every sensor has one waiting (nothing earlier can come then), or when it lies more
    than `window_s` behind the newest one, or when `MAX_HELD` are waiting. What comes later than that is
    yielded out of order: the caller sees it by its stamp. Readings of equal stamp keep their order.

    Parameters
    ----------
    readings : iterable
        In the order of the recording.
    sensors : collection of str
        The sensors that give readings.
    window_s : float
        How far a sensor may lag [s].
    """
    if len(sensors) <= 1:
        yield from readings
        return
    heap: list[tuple[float, int, StampedT]] = []
    waiting: Counter[str] = Counter()
    newest_s = -math.inf
    for order, reading in enumerate(readings):
        heapq.heappush(heap, (reading.stamp_s, order, reading))
        waiting[reading.sensor] += 1
        newest_s = max(newest_s, reading.stamp_s)
        while heap and (
            all(waiting[name] for name in sensors) or newest_s - heap[0][0] > window_s or len(heap) > MAX_HELD
        ):
            oldest = heapq.heappop(heap)[2]
            waiting[oldest.sensor] -= 1
            yield oldest
    yield from (heapq.heappop(heap)[2] for _ in range(len(heap)))
