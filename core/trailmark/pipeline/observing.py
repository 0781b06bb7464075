"""Calling one localizer: timed, guarded, and told what its last call took."""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter_ns
from typing import Protocol

from trailmark.errors import RunError
from trailmark.estimates import Belief, Estimate
from trailmark.frames import Frame, SensorInfo
from trailmark.pipeline.mailbox import is_snapshot
from trailmark.pipeline.plan import PlannedLocalizer

__all__ = ["Answer", "Asked", "Observing", "SyncLocalizer"]


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What a localizer said about a frame, and when that arrived [s]."""

    arrived_s: float
    frame_s: float
    estimates: Sequence[Estimate]


class Asked(Protocol):
    """A localizer at work: beside the run or within it."""

    @property
    def planned(self) -> PlannedLocalizer:
        """The localizer."""

    def take(self, frame: Frame, belief: Belief) -> Sequence[Answer]:
        """Hand over a frame; returns what the localizer answers at once."""

    def arrived(self, now_s: float) -> Sequence[Answer]:
        """Return the answers that have arrived until `now_s`, each once; raise RunError when they are told."""

    def finish(self) -> Sequence[Answer]:
        """Return the answer that is still in work; frames that wait are given up and counted."""

    def close(self) -> None:
        """Stop working."""


class Observing:
    """Calls `Localizer.observe`.

    Parameters
    ----------
    planned : PlannedLocalizer
        The localizer.
    sensors : mapping of str to SensorInfo
        The sensors of the run.
    times : array of int
        Takes the duration of every call [ns].
    is_realtime : bool
        Whether the localizer is told measured durations, or modelled ones.
    """

    def __init__(
        self, planned: PlannedLocalizer, sensors: Mapping[str, SensorInfo], times: array[int], is_realtime: bool
    ) -> None:
        self.planned = planned
        self.last_latency_s = 0.0
        self._times = times
        self._is_realtime = is_realtime
        kinds = {sensors[name].kind for name in planned.sensors if name in sensors}
        self._has_snapshots = bool(kinds & {"image", "rgbd", "scan"})

    def observe(self, frame: Frame, belief: Belief) -> tuple[Sequence[Estimate], float]:
        """Return what the localizer says, and how long that takes by its model [s].

        Raises
        ------
        RunError
            If it raises or returns what is no sequence of estimates; the message names it and the frame.
        """
        localizer = self.planned.localizer
        began_ns = perf_counter_ns()
        try:
            estimates = localizer.observe(frame, belief)
            if not isinstance(estimates, list | tuple | Sequence):
                raise TypeError(f"observe returned {type(estimates).__name__}, not a sequence of estimates")
        except Exception as error:
            raise self._failed(frame, error) from error
        elapsed_ns = perf_counter_ns() - began_ns
        self._times.append(elapsed_ns)
        modelled_s = self._modelled_s(frame)
        self.last_latency_s = elapsed_ns * 1e-9 if self._is_realtime else modelled_s
        return estimates, modelled_s

    def _modelled_s(self, frame: Frame) -> float:
        """Return the latency in step pace; of a localizer that looks at pictures, only pictures cost time."""
        if self.planned.latency_s is None:
            return self.planned.localizer.latency_s() or 0.0
        return self.planned.latency_s if is_snapshot(frame) or not self._has_snapshots else 0.0

    def _failed(self, frame: Frame, error: Exception) -> RunError:
        part = f"localizer {self.planned.name!r}"
        story = f"{type(error).__name__}: {error}".rstrip(": ")
        return RunError(f"{part} failed at the frame of {frame.sensor!r} at {frame.stamp_s:.6f} s: {story}", part)


class SyncLocalizer:
    """A localizer that is waited for."""

    def __init__(self, observing: Observing) -> None:
        self._observing = observing

    @property
    def planned(self) -> PlannedLocalizer:
        """The localizer."""
        return self._observing.planned

    def take(self, frame: Frame, belief: Belief) -> Sequence[Answer]:
        """Ask the localizer; its answer is there at once."""
        estimates, _ = self._observing.observe(frame, belief)
        return (Answer(frame.stamp_s, frame.stamp_s, estimates),) if estimates else ()

    def arrived(self, now_s: float) -> Sequence[Answer]:
        """Return nothing: all was said at once."""
        return ()

    def finish(self) -> Sequence[Answer]:
        """Return nothing: all was said at once."""
        return ()

    def close(self) -> None:
        """Have nothing to stop."""
