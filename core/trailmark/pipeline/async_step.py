"""A localizer beside the run, on the virtual clock: its answers arrive when its latency has passed."""

from __future__ import annotations

from collections.abc import Sequence

from trailmark.errors import RunError
from trailmark.estimates import Belief
from trailmark.frames import Frame
from trailmark.pipeline.counters import Counters
from trailmark.pipeline.mailbox import Mailbox
from trailmark.pipeline.observing import Answer, Observing
from trailmark.pipeline.plan import PlannedLocalizer

__all__ = ["AsyncStep"]


class AsyncStep:
    """Handed frame and belief at the frame's stamp, a localizer answers `latency` later.

    It is called at once, and its answer held back: on the virtual clock only the order of events counts. While it
    works, frames wait in its mailbox; it goes on with the oldest of them at the instant at which it is done.
    """

    def __init__(self, observing: Observing, counters: Counters) -> None:
        self._observing = observing
        self._counters = counters
        self._mailbox = Mailbox()
        self._pending: Answer | None = None
        self._error: RunError | None = None

    @property
    def planned(self) -> PlannedLocalizer:
        """The localizer."""
        return self._observing.planned

    def take(self, frame: Frame, belief: Belief) -> Sequence[Answer]:
        """Begin with a frame, or leave it in the mailbox; what takes no time is answered at once."""
        if self._error is not None:
            raise self._error
        if self._pending is None:
            self._begin(frame, belief, frame.stamp_s)
            return self.arrived(frame.stamp_s)
        if self._mailbox.put(frame, belief):
            self._counters.add(f"localizer.{self.planned.name}.overwritten")
        return ()

    def arrived(self, now_s: float) -> Sequence[Answer]:
        """Return the answers that are due until `now_s`.

        Raises
        ------
        RunError
            If the localizer has raised, once the answers from before are told.
        """
        answers = []
        while self._pending is not None and self._pending.arrived_s <= now_s:
            done, self._pending = self._pending, None
            if done.estimates:
                answers.append(done)
            self._go_on(done.arrived_s)
        if self._error is not None and not answers:
            raise self._error
        return answers

    def finish(self) -> Sequence[Answer]:
        """Return the answer that is on its way; what waits in the mailbox is given up and counted."""
        if len(self._mailbox):
            self._counters.add(f"localizer.{self.planned.name}.given_up", len(self._mailbox))
        self._mailbox = Mailbox()
        last, self._pending = self._pending, None
        return (last,) if last is not None and last.estimates else ()

    def close(self) -> None:
        """Forget what is on its way."""
        self._pending, self._mailbox = None, Mailbox()

    def _go_on(self, now_s: float) -> None:
        letter = self._mailbox.take()
        if letter is not None:
            try:
                self._begin(*letter, now_s)
            except RunError as error:
                self._error = error

    def _begin(self, frame: Frame, belief: Belief, began_s: float) -> None:
        estimates, latency_s = self._observing.observe(frame, belief)
        self._pending = Answer(began_s + latency_s, frame.stamp_s, estimates)
