"""A localizer beside the run, on the virtual clock: its results arrive when its modelled latency has passed."""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence

from trailmark.errors import RunError
from trailmark.estimates import Belief
from trailmark.frames import Frame, SensorInfo
from trailmark.pipeline.instruments import Counters
from trailmark.pipeline.localizers.mailbox import Mailbox
from trailmark.pipeline.localizers.runner import LocalizerRunner, ObserveResult
from trailmark.pipeline.parts import LocalizerPart

__all__ = ["ModelledRunner"]


class ModelledRunner(LocalizerRunner):
    """Handed frame and belief at the frame's stamp, a localizer's result arrives `latency` later.

    The localizer is called at once, and its result held back: on the virtual clock only the order of events counts.
    While it works, frames wait in its mailbox; it goes on with the oldest of them at the instant at which it is done.
    """

    def __init__(
        self, part: LocalizerPart, sensors: Mapping[str, SensorInfo], times: array[int], counters: Counters
    ) -> None:
        super().__init__(part, sensors, times, is_realtime=False)
        self._counters = counters
        self._mailbox = Mailbox()
        self._pending: ObserveResult | None = None
        self._error: RunError | None = None

    def submit(self, frame: Frame, belief: Belief) -> Sequence[ObserveResult]:
        """Begin with a frame, or leave it in the mailbox; what takes no time is returned at once."""
        if self._error is not None:
            raise self._error
        if self._pending is None:
            self._begin(frame, belief, frame.stamp_s)
            return self.poll(frame.stamp_s)
        if self._mailbox.put(frame, belief):
            self._counters[f"localizer.{self.name}.overwritten"] += 1
        return ()

    def poll(self, now_s: float) -> Sequence[ObserveResult]:
        """Return the results that are due until `now_s`."""
        results = []
        while self._pending is not None and self._pending.arrived_s <= now_s:
            done, self._pending = self._pending, None
            if done.estimates:
                results.append(done)
            self._begin_next(done.arrived_s)
        if self._error is not None and not results:
            raise self._error
        return results

    def drain(self) -> Sequence[ObserveResult]:
        """Return the result that is on its way; what waits in the mailbox is given up and counted."""
        self._mailbox.give_up(self._counters, self.name)
        last, self._pending = self._pending, None
        return (last,) if last is not None and last.estimates else ()

    def close(self) -> None:
        """Forget what is on its way."""
        self._pending, self._mailbox = None, Mailbox()

    def _begin_next(self, now_s: float) -> None:
        letter = self._mailbox.take()
        if letter is not None:
            try:
                self._begin(*letter, now_s)
            except RunError as error:
                self._error = error

    def _begin(self, frame: Frame, belief: Belief, began_s: float) -> None:
        estimates, latency_s = self._observe(frame, belief)
        self._pending = ObserveResult(began_s + latency_s, frame.stamp_s, estimates)
