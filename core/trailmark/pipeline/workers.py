"""A localizer beside the run, in real time: a thread with a mailbox."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from trailmark.errors import RunError
from trailmark.estimates import Belief
from trailmark.frames import Frame
from trailmark.pipeline.counters import Counters
from trailmark.pipeline.mailbox import Mailbox
from trailmark.pipeline.observing import Answer, Observing
from trailmark.pipeline.plan import PlannedLocalizer

__all__ = ["Worker"]

# A localizer that does not come back is left behind: its thread is a daemon.
_PATIENCE_S = 5.0


class Worker:
    """Works on frames in a thread of its own. An error that the localizer raises reaches the run with its answers.

    Parameters
    ----------
    observing : Observing
        Calls the localizer.
    counters : Counters
        Of the run.
    now_s : callable
        The run's clock.
    wake : threading.Event
        Set when an answer has arrived.
    """

    def __init__(
        self, observing: Observing, counters: Counters, now_s: Callable[[], float], wake: threading.Event
    ) -> None:
        self._observing = observing
        self._counters = counters
        self._now_s = now_s
        self._wake = wake
        self._mailbox = Mailbox()
        self._answers: list[Answer] = []
        self._error: RunError | None = None
        self._is_closed = False
        self._is_busy = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name=f"localizer {self.planned.name}", daemon=True)
        self._thread.start()

    @property
    def planned(self) -> PlannedLocalizer:
        """The localizer."""
        return self._observing.planned

    def take(self, frame: Frame, belief: Belief) -> Sequence[Answer]:
        """Leave a frame in the mailbox."""
        with self._changed:
            if self._mailbox.put(frame, belief):
                self._counters.add(f"localizer.{self.planned.name}.overwritten")
            self._changed.notify_all()
        return ()

    def arrived(self, now_s: float) -> Sequence[Answer]:
        """Return the answers that have arrived.

        Raises
        ------
        RunError
            If the localizer has raised, once the answers from before are told.
        """
        with self._changed:
            answers, self._answers = self._answers, []
            error = self._error
        if error is not None and not answers:
            raise error
        return answers

    def finish(self) -> Sequence[Answer]:
        """Wait for the answer that is in work; frames that wait are given up and counted."""
        with self._changed:
            if len(self._mailbox):
                self._counters.add(f"localizer.{self.planned.name}.given_up", len(self._mailbox))
            self._mailbox = Mailbox()
            self._changed.wait_for(lambda: not self._is_busy, _PATIENCE_S)
        return self.arrived(self._now_s())

    def close(self) -> None:
        """End the thread; what is in work is not waited for long."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()
        if self._thread is not threading.current_thread():
            self._thread.join(_PATIENCE_S)

    def _work(self) -> None:
        while (letter := self._next()) is not None:
            try:
                estimates, _ = self._observing.observe(*letter)
                answer = Answer(self._now_s(), letter[0].stamp_s, estimates) if estimates else None
                error = None
            except RunError as raised:
                answer, error = None, raised
            with self._changed:
                self._is_busy = False
                self._error = self._error or error
                if answer is not None:
                    self._answers.append(answer)
                self._changed.notify_all()
            self._wake.set()

    def _next(self) -> tuple[Frame, Belief] | None:
        """Wait for a frame; None when closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._is_closed or len(self._mailbox) > 0)
            if self._is_closed:
                return None
            self._is_busy = True
            return self._mailbox.take()
