"""Frames in real time: held to their stamps, or as a device gives them.

Both are generators of events: a `Frame`, or a `Tick` at which only the controller is asked.
"""

from __future__ import annotations

import logging
import math
import threading
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass

from trailmark.clock import RunClock
from trailmark.frames import Frame
from trailmark.interruption import join
from trailmark.pipeline.instruments import Counters
from trailmark.pipeline.sources.ordering import StampOrder
from trailmark.pipeline.sources.stream import SourceStream

__all__ = ["Event", "Tick", "held_to_stamps", "live"]

logger = logging.getLogger(__name__)

# Nobody can wait for less; a difference of two clocks is never exactly zero.
_NOW_S = 1e-6

# Until a sensor's delay is learnt some frames are late; as many are no start any more.
_MANY_LATE = 20

# A device that does not let go is left behind: its thread is a daemon.
_PATIENCE_S = 2.0


@dataclass(frozen=True, slots=True)
class Tick:
    """An instant at which the controller is asked although no frame has come."""

    stamp_s: float


#: What a run goes on with.
Event = Frame | Tick


def held_to_stamps(frames: Iterator[Frame], clock: RunClock, due_s: Callable[[], float]) -> Generator[Event]:
    """Yield recorded frames at the times of their stamps, and ticks between them.

    A run that is too slow gets its frames late, never fewer of them.

    Parameters
    ----------
    frames : iterator of Frame
        The recording.
    clock : RunClock
        Anchored at the first frame.
    due_s : callable
        Returns when the controller is to be asked next; ``inf``: never [s].
    """
    for index, frame in enumerate(frames):
        if index == 0:
            clock.anchor(frame.stamp_s)
        while (now_s := clock.now_s()) < frame.stamp_s - _NOW_S:
            if due_s() <= now_s + _NOW_S:
                yield Tick(now_s)
            else:
                clock.wait(min(frame.stamp_s, due_s()))
        yield frame


def live(
    sources: Sequence[SourceStream], clock: RunClock, due_s: Callable[[], float], counters: Counters
) -> Generator[Event]:
    """Yield the frames of devices as they come, and ticks while none does.

    Every source is read by a thread of its own. Frames of several sensors come in the order of their stamps, within the
    ``reorder_s`` of their sources; what is later still is counted as ``source.NAME.late``. Of each camera and laser two
    frames may wait, of other sensors 200; then the oldest is dropped and counted as ``source.NAME.dropped``.

    Raises
    ------
    SourceError
        If a source does; after the frames that came before.
    """
    intake = _Intake(sources, counters, clock)
    for source in sources:
        intake.read(source)
    try:
        while True:
            now_s, is_over = clock.now_s(), intake.is_over  # asked first: the last frame may come just before the end
            if (frame := intake.take(math.inf if is_over else now_s)) is not None:
                yield frame
            elif is_over:
                intake.raise_error()
                return
            elif -math.inf < due_s() <= now_s + _NOW_S:
                yield Tick(now_s)
            else:
                clock.wait(min(due_s() if due_s() > -math.inf else math.inf, intake.due_s(now_s)))
    finally:
        intake.join()


class _Intake:
    """Takes frames from the threads of live sources."""

    def __init__(self, sources: Sequence[SourceStream], counters: Counters, clock: RunClock) -> None:
        self._counters = counters
        self._clock = clock
        self._lock = threading.Lock()
        self._source_of = {sensor: source.name for source in sources for sensor in source.sensors}
        self._windows_s = {sensor: source.reorder_s for source in sources for sensor in source.sensors}
        self._n_late: Counter[str] = Counter()
        self._order = StampOrder(self._windows_s, self._count)
        self._n_open = 0
        self._threads: list[threading.Thread] = []
        self._error: BaseException | None = None

    def read(self, source: SourceStream) -> None:
        """Begin to read a source."""
        self._n_open += 1
        thread = threading.Thread(target=self._read, args=(source,), name=f"source {source.name}", daemon=True)
        self._threads.append(thread)
        thread.start()

    def join(self) -> None:
        """Wait for the threads of sources that are closed; one that hangs is left behind."""
        for thread in self._threads:
            join(thread, _PATIENCE_S)

    @property
    def is_over(self) -> bool:
        """Whether all sources have ended, or one has failed."""
        return self._n_open == 0 or self._error is not None

    def take(self, now_s: float) -> Frame | None:
        """Return the earliest frame, if it need not wait for others."""
        with self._lock:
            return self._order.take(now_s)

    def due_s(self, now_s: float) -> float:
        """Return when the earliest frame need not wait any longer; ``inf``: there is none [s]."""
        with self._lock:
            return self._order.due_s(now_s)

    def raise_error(self) -> None:
        """Raise what a source raised."""
        if self._error is not None:
            raise self._error

    def _read(self, source: SourceStream) -> None:
        try:
            for frame in source.frames():
                self._put(frame)
        except BaseException as error:  # carried to the run's thread
            self._error = error
        finally:
            with self._lock:
                self._n_open -= 1
            self._clock.wake.set()

    def _put(self, frame: Frame) -> None:
        with self._lock:
            self._order.put(frame, self._clock.now_s())
        self._clock.wake.set()

    def _count(self, sensor: str, what: str) -> None:
        source = self._source_of[sensor]
        self._counters.add(f"source.{source}.{what}")
        self._n_late[sensor] += what == "late"
        if what == "late" and self._n_late[sensor] == _MANY_LATE:
            logger.warning(
                "%d frames of %r came more than %g s behind those of other sensors and were left out, others silently:"
                " is sources.%s.reorder_s too short, or its clock another?",
                _MANY_LATE,
                sensor,
                self._windows_s[sensor],
                source,
            )
