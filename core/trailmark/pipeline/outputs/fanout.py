"""Telling the sinks what happens."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from time import perf_counter_ns
from typing import Any

from trailmark.failures import raise_failure
from trailmark.interfaces import RunEnd, Sink
from trailmark.pipeline.instruments import StageTimes

__all__ = ["SinkFanout"]

_Listener = tuple[str, Callable[..., None], "array[int]"]

#: What sinks are told, and the methods that a sink overrides to hear it.
_OVERRIDES: dict[Callable[..., None], tuple[str, ...]] = {
    Sink.on_frame: ("on_frame",),
    Sink.on_estimate_record: ("on_estimate_record", "on_estimate"),
    Sink.on_belief: ("on_belief",),
    Sink.on_command: ("on_command",),
    Sink.on_end: ("on_end",),
}


class SinkFanout:
    """Calls each sink in turn, those methods alone that it overrides: timed as ``sink.NAME``, errors naming it.

    Parameters
    ----------
    sinks : mapping of str to Sink
        In the order in which they are told.
    times : StageTimes
        Of the run.
    """

    def __init__(self, sinks: Mapping[str, Sink], times: StageTimes) -> None:
        self._listeners: dict[Callable[..., None], list[_Listener]] = {
            method: [
                (name, getattr(sink, method.__name__), times.stage(f"sink.{name}"))
                for name, sink in sinks.items()
                if any(getattr(type(sink), own) is not getattr(Sink, own) for own in overrides)
            ]
            for method, overrides in _OVERRIDES.items()
        }

    def tell(self, method: Callable[..., None], *arguments: Any, to: Sequence[_Listener] | None = None) -> None:
        """Call a method of `Sink` on every sink that overrides it, or on some: ``tell(Sink.on_belief, belief)``.

        Raises
        ------
        RunError
            If a sink raises what is no error of Trailmark.
        """
        for name, call, times in self._listeners[method] if to is None else to:
            began_ns = perf_counter_ns()
            try:
                call(*arguments)
            except BaseException as error:
                raise_failure(error, f"sink {name!r}", method.__name__)
            times.append(perf_counter_ns() - began_ns)

    def on_end(self, end: RunEnd) -> Iterator[Callable[[], None]]:
        """Yield a call of `Sink.on_end` for each sink; one that raises does not keep it from the others."""
        for listener in self._listeners[Sink.on_end]:
            yield partial(self.tell, Sink.on_end, end, to=[listener])
