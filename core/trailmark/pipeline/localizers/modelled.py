"""A localizer beside the run, on the virtual clock: its results arrive when latency and delay have passed."""

from __future__ import annotations

from array import array
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace

from trailmark.errors import RunError
from trailmark.estimates import Belief
from trailmark.frames import Frame, SensorInfo
from trailmark.pipeline.instruments import Counters
from trailmark.pipeline.localizers.mailbox import Mailbox
from trailmark.pipeline.localizers.runner import LocalizerRunner, ObserveResult
from trailmark.pipeline.parts import LocalizerPart

__all__ = ["ModelledRunner"]


class ModelledRunner(LocalizerRunner):
    """Handed frame and belief at the frame's stamp, a localizer's result arrives `latency` and `delay` later.

    The localizer is called at once, and its result held back: on the virtual clock only the order of events counts.
    For its latency it is busy: frames wait in its mailbox, and it goes on with the oldest of them at the instant at
    which it is done. The delay is the way of its results: any number are under way at once. A localizer that is waited
    for has a delay alone.
    """

    def __init__(
        self, part: LocalizerPart, sensors: Mapping[str, SensorInfo], times: array[int], counters: Counters
    ) -> None:
        super().__init__(part, sensors, times, is_realtime=False)
        self._counters = counters
        self._is_async, self._delay_s = part.options.is_async, part.options.delay_s
        self._mailbox = Mailbox(keeps_all=part.options.keep == "all")
        self._in_work: ObserveResult | None = None
        self._under_way: deque[ObserveResult] = deque()
        self._error: RunError | None = None

    def submit(self, frame: Frame, belief: Belief) -> Sequence[ObserveResult]:
        """Begin with a frame, or leave it in the mailbox; what takes no time is returned at once."""
        if self._error is not None:
            raise self._error
        if self._in_work is None:
            self._begin(frame, belief, frame.stamp_s)
            return self.poll(frame.stamp_s)
        if self._mailbox.put(frame, belief):
            self._counters[f"localizer.{self.name}.overwritten"] += 1
        return ()

    def poll(self, now_s: float) -> Sequence[ObserveResult]:
        """Return the results that are due until `now_s`."""
        while self._in_work is not None and self._in_work.arrived_s <= now_s:
            done = self._in_work
            self._send(done)
            self._begin_next(done.arrived_s)
        results = []
        while self._under_way and self._under_way[0].arrived_s <= now_s:
            results.append(self._under_way.popleft())
        if self._error is not None and not results and not self._under_way:
            raise self._error
        return results

    def drain(self) -> Sequence[ObserveResult]:
        """Return the results that are on their way; what waits in the mailbox is given up and counted."""
        self._mailbox.give_up(self._counters, self.name)
        if self._in_work is not None:
            self._send(self._in_work)
        results = tuple(self._under_way)
        self._under_way.clear()
        return results

    def close(self) -> None:
        """Forget what is on its way."""
        self._in_work = None
        self._under_way.clear()
        self._mailbox = Mailbox()

    def _begin_next(self, now_s: float) -> None:
        letter = self._mailbox.take()
        if letter is not None:
            try:
                self._begin(*letter, now_s)
            except RunError as error:
                self._error = error

    def _begin(self, frame: Frame, belief: Belief, began_s: float) -> None:
        estimates, latency_s = self._observe(frame, belief)
        done_s = began_s + (latency_s if self._is_async else 0.0)
        self._in_work = ObserveResult(done_s, frame.stamp_s, estimates)

    def _send(self, done: ObserveResult) -> None:
        """Let a result that is done go its way."""
        self._in_work = None
        if done.estimates:
            self._under_way.append(replace(done, arrived_s=done.arrived_s + self._delay_s))
