"""A localizer beside the run, in real time: a thread with a mailbox."""

from __future__ import annotations

import math
import threading
from array import array
from collections.abc import Mapping, Sequence
from time import monotonic

from trailmark.errors import RunError
from trailmark.estimates import Belief
from trailmark.frames import Frame, SensorInfo
from trailmark.interfaces import Session
from trailmark.interruption import join
from trailmark.pipeline.instruments import Instruments
from trailmark.pipeline.localizers.mailbox import Mailbox
from trailmark.pipeline.localizers.runner import LocalizerFailedError, LocalizerRunner, ObserveResult
from trailmark.pipeline.parts import LocalizerPart

__all__ = ["ThreadedRunner"]

# A localizer that does not come back is left behind: its thread is a daemon.
_PATIENCE_S = 5.0


class ThreadedRunner(LocalizerRunner):
    """Runs a localizer in a thread of its own. What it raises reaches the run with its results.

    Parameters
    ----------
    part, sensors, times
        As of `LocalizerRunner`.
    instruments : Instruments
        Of the run; its clock is woken when a result has arrived.
    """

    def __init__(
        self,
        part: LocalizerPart,
        sensors: Mapping[str, SensorInfo],
        times: array[int],
        instruments: Instruments,
    ) -> None:
        super().__init__(part, sensors, times, is_realtime=True)
        self._patience_s = instruments.patience_s
        self._work_began_s = math.inf
        self._counters = instruments.counters
        self._clock = instruments.clock
        self._mailbox = Mailbox(keeps_all=part.options.keep == "all")
        self._results: list[ObserveResult] = []
        self._error: RunError | None = None
        self._is_closed = False
        self._is_busy = False
        self._has_given_up = False
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None

    def start(self, session: Session) -> None:
        """Start the localizer, then its thread."""
        super().start(session)
        self._thread = threading.Thread(target=self._work, name=f"localizer {self.name}", daemon=True)
        self._thread.start()

    def submit(self, frame: Frame, belief: Belief) -> Sequence[ObserveResult]:
        """Leave a frame in the mailbox."""
        with self._changed:
            if self._mailbox.put(frame, belief):
                self._counters[f"localizer.{self.name}.overwritten"] += 1
            self._changed.notify_all()
        return ()

    def poll(self, now_s: float) -> Sequence[ObserveResult]:
        """Return the results that have arrived."""
        with self._changed:
            results, self._results = self._results, []
            if self._is_busy and monotonic() - self._work_began_s > self._patience_s:
                self._give_up(f"for {self._patience_s:g} s (patience_s)")
            error = self._error
        if error is not None and not results:
            raise error
        return results

    def drain(self) -> Sequence[ObserveResult]:
        """Wait for the result that is in work; frames that wait are given up and counted."""
        with self._changed:
            self._mailbox.give_up(self._counters, self.name)
            if not self._changed.wait_for(lambda: not self._is_busy, _PATIENCE_S):
                self._give_up(f"{_PATIENCE_S:g} s after the last frame")
        return self.poll(self._clock.now_s())

    def close(self) -> None:
        """End the thread; what is in work is not waited for long."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()
            patience_s = 0.0 if self._has_given_up else _PATIENCE_S
        if self._thread is not None and self._thread is not threading.current_thread():
            join(self._thread, patience_s)

    def _give_up(self, how_long: str) -> None:
        """Take a call that does not come back for a failure; its thread is left behind."""
        part = f"localizer {self.name!r}"
        self._has_given_up = True
        self._error = self._error or LocalizerFailedError(
            f"{part} failed in observe: it has not come back {how_long}", part
        )

    def _work(self) -> None:
        while (letter := self._next_letter()) is not None:
            try:
                estimates, _ = self._observe(*letter)
                result = ObserveResult(self._clock.now_s(), letter[0].stamp_s, estimates) if estimates else None
                error = None
            except RunError as raised:
                result, error = None, raised
            with self._changed:
                self._is_busy = False
                self._error = self._error or error
                if result is not None:
                    self._results.append(result)
                self._changed.notify_all()
            self._clock.wake.set()

    def _next_letter(self) -> tuple[Frame, Belief] | None:
        """Wait for a frame; None when closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._is_closed or len(self._mailbox) > 0)
            if self._is_closed:
                return None
            self._is_busy, self._work_began_s = True, monotonic()
            return self._mailbox.take()
