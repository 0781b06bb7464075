"""Faults of cached sources: applied by the first cell that asks, and taken from the cache by all others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trailmark.config.run import FaultEntry, PartEntry
from trailmark.frames import Frame, SensorInfo
from trailmark.interfaces import Fault, Session
from trailmark.isolation.fingerprint import digest_of
from trailmark.isolation.plain import to_plain_bytes
from trailmark_bench.cached_source import CachedSource
from trailmark_bench.frame_cache import FrameArchive, FrameCache, FrameRecording

__all__ = ["CachedFault", "CachedFaultEntry", "FaultySource"]

# What became of a frame: it is as it was, lost, or another one, which is kept.
_SAME, _LOST, _CHANGED = "=", "-", "+"


@dataclass(slots=True)
class FaultySource:
    """The source whose frames some faults befall; it is constructed before they are."""

    source: CachedSource | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CachedFaultEntry(FaultEntry):
    """A fault whose frames are kept, where those of its source are.

    Attributes
    ----------
    cache : FrameCache
        Where frames are.
    facts : mapping
        This fault and those before it, as they are written, their code, and the sensors that they befall: plain data.
    befallen : FaultySource
        What it befalls.
    """

    cache: FrameCache
    facts: Mapping[str, Any]
    befallen: FaultySource = field(default_factory=FaultySource)

    def construct(self) -> Fault:
        fault: Fault = PartEntry.construct(self)
        source = self.befallen.source
        return fault if source is None else CachedFault(fault, source, self.cache, self.facts)


class CachedFault(Fault):
    """A fault of one sensor: what it makes of frames is taken from a cache, or goes into it.

    What a fault makes depends on the frames, on the faults before it, its config, its code and what it is told at its
    start. Where the frames of the source are those of one run alone, it passes through.

    Parameters
    ----------
    fault : Fault
        It is started in any case, and asked only where there is no archive.
    source : CachedSource
        Of the frames; started before this.
    cache : FrameCache
        Where frames are.
    facts : mapping
        What is known before the start: plain data.
    """

    _steps: list[str]
    _counts: list[tuple[int, dict[str, int]]]
    _frames: Iterator[Frame]

    def __init__(self, fault: Fault, source: CachedSource, cache: FrameCache, facts: Mapping[str, Any]) -> None:
        super().__init__(fault.config)
        self.kinds = fault.kinds  # type: ignore[misc]  # of this one, not of the class
        self._fault = fault
        self._source = source
        self._cache = cache
        self._facts = facts
        self._archive: FrameArchive | None = None
        self._recording: FrameRecording | None = None

    def idle_options(self, info: SensorInfo) -> Mapping[str, str]:
        """Return those of the fault."""
        return self._fault.idle_options(info)

    def start(self, session: Session) -> None:
        """Find the frames; the fault starts whether there are any or not, for what is believed of the sensor."""
        key = self._key_of(session)
        self._archive = None if key is None else self._cache.find(key, type(self._fault).__module__.partition(".")[0])
        self._fault.start(session)
        self._n, self._steps, self._counts = 0, [], [(0, dict(self._fault.counters()))]
        if self._archive is not None:
            self._frames = iter(self._archive.frames)
            self._steps, self._counts = self._archive.notes["steps"], self._archive.notes["counts"]
        elif key is not None:
            with suppress(OSError):
                self._recording = self._cache.record(key)

    def close(self) -> None:
        """Keep what was made of the frames, if the source has given all of them."""
        recording, self._recording = self._recording, None
        if recording is not None and self._source.has_ended:
            notes = {"steps": self._steps, "counts": self._counts}
            facts = {"sensors": {}, "accepts": (), "ground_truth": None, "notes": notes}
            with suppress(OSError, TypeError):
                recording.commit(facts, {})
        elif recording is not None:
            recording.abandon()
        self._fault.close()

    def believed(self, info: SensorInfo) -> SensorInfo:
        """Return the sensor as the run shall know it."""
        return self._fault.believed(info)

    def counters(self) -> Mapping[str, int]:
        """Return what the fault had counted after as many frames."""
        if self._archive is None:
            return self._fault.counters()
        counts: Mapping[str, int] = [counts for n, counts in self._counts if n <= self._n][-1]
        return counts

    def apply(self, frame: Frame, rng: np.random.Generator, since_s: float) -> Frame | None:
        """Return a frame as the fault leaves it."""
        self._n += 1
        if self._archive is not None:
            step = self._steps[self._n - 1]
            return frame if step == _SAME else None if step == _LOST else next(self._frames)
        left = self._fault.apply(frame, rng, since_s)
        if self._recording is not None:
            self._keep(self._recording, frame, left)
        return left

    def _keep(self, recording: FrameRecording, frame: Frame, left: Frame | None) -> None:
        """Write what a frame has become; a run goes on without an archive where it cannot be written."""
        self._steps.append(_LOST if left is None else _SAME if left is frame else _CHANGED)
        counts = dict(self._fault.counters())
        if counts != self._counts[-1][1]:
            self._counts.append((self._n, counts))
        try:
            if left is not None and left is not frame:
                recording.add(left, {})
        except (OSError, TypeError, AttributeError):  # no room; no frame, which the run will say
            recording.abandon()
            self._recording = None

    def _key_of(self, session: Session) -> str | None:
        """Return the digest of all that its frames depend on; None where the source's are of this run alone."""
        frames = self._source.frames_key
        if frames is None:
            return None
        told = {
            "name": session.name,
            "mode": session.mode,
            "sensors": to_plain_bytes(dict(session.sensors)).decode(),
            "rng": session.rng.bit_generator.state,
        }
        return digest_of({**self._facts, "frames": frames, "session": told})
