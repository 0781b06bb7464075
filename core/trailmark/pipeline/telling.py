"""Telling the sinks what happens."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping
from time import perf_counter_ns
from typing import Any

from trailmark.commands import Command
from trailmark.errors import RunError, TrailmarkError
from trailmark.estimates import Belief
from trailmark.frames import Frame
from trailmark.interfaces import RunEnd, Sink
from trailmark.pipeline.steps import Told
from trailmark.pipeline.timing import StageTimes
from trailmark.pipeline.tracks import ToldSink

__all__ = ["Telling"]

Listener = tuple[str, Callable[..., None], "array[int]"]


class Telling:
    """Calls each sink in turn, those methods alone that it has: timed as ``sink.NAME``, errors naming it.

    Parameters
    ----------
    sinks : mapping of str to Sink
        In the order in which they are told.
    times : StageTimes
        Of the run.
    """

    def __init__(self, sinks: Mapping[str, Sink], times: StageTimes) -> None:
        self._sinks = sinks
        self._times = times
        self._on_frame = self._listeners(Sink.on_frame)
        self._on_estimate = self._listeners(Sink.on_estimate)
        self._on_told = self._listeners(ToldSink.on_told)
        self._on_belief = self._listeners(Sink.on_belief)
        self._on_command = self._listeners(Sink.on_command)
        self._on_end = self._listeners(Sink.on_end)

    def frame(self, frame: Frame) -> None:
        """A frame was taken from a source."""
        _call(self._on_frame, frame)

    def told(self, told: Told) -> None:
        """An estimate was applied."""
        _call(self._on_estimate, told.source, told.estimate, told.applied)
        _call(self._on_told, told)

    def belief(self, belief: Belief) -> None:
        """All localizers saw a frame."""
        _call(self._on_belief, belief)

    def command(self, stamp_s: float, command: Command) -> None:
        """A command was given."""
        _call(self._on_command, stamp_s, command)

    def end(self, end: RunEnd) -> None:
        """The run is over."""
        _call(self._on_end, end)

    def _listeners(self, method: Callable[..., None]) -> list[Listener]:
        """Return the sinks that have a method of their own in place of this one, which does nothing."""
        name = method.__name__
        return [
            (sink_name, getattr(sink, name), self._times.stage(f"sink.{sink_name}"))
            for sink_name, sink in self._sinks.items()
            if getattr(type(sink), name, method) is not method
        ]


def _call(listeners: list[Listener], *arguments: Any) -> None:
    for name, call, times in listeners:
        began_ns = perf_counter_ns()
        try:
            call(*arguments)
        except TrailmarkError:
            raise
        except Exception as error:
            part = f"sink {name!r}"
            raise RunError(f"{part} failed: {type(error).__name__}: {error}", part) from error
        times.append(perf_counter_ns() - began_ns)
