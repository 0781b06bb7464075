"""Simulated sources whose frames come from a cache: rendered by the first cell that asks, played to all others."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from contextlib import suppress
from importlib.metadata import version
from typing import Any

from trailmark import commands
from trailmark.commands import Command
from trailmark.frames import Frame, SensorInfo
from trailmark.geometry import Trajectory
from trailmark.interfaces import Drivable, Session
from trailmark.isolation.fingerprint import digest_of
from trailmark.isolation.plain import to_plain_bytes
from trailmark_bench.frame_cache import FrameArchive, FrameCache, FrameRecording

__all__ = ["CachedSource", "renderer_versions"]

logger = logging.getLogger(__name__)

# What renders, besides the source's own code.
_RENDERERS = ("numpy", "scipy", "numba", "opencv-contrib-python-headless")


def renderer_versions() -> list[str]:
    """Return the versions of the numeric libraries that frames depend on."""
    return [version(name) for name in _RENDERERS]


class CachedSource(Drivable):
    """A source that drives itself: its frames are taken from a cache, or go into it while they are taken.

    What it gives depends on its config, its code and what it is told at its start, a taught path too. A source that
    others drive passes through: its frames are those of one run alone.

    Parameters
    ----------
    source : Drivable
        Asked only where there is no archive.
    cache : FrameCache
        Where frames are.
    facts : mapping
        What frames depend on that is known before the start: plain data.
    """

    def __init__(self, source: Drivable, cache: FrameCache, facts: Mapping[str, Any]) -> None:
        super().__init__(source.config)
        self._source = source
        self._cache = cache
        self._facts = facts
        self._archive: FrameArchive | None = None
        self._n_played = 0
        self._is_closed = False
        #: Whether it has given all of its frames.
        self.has_ended = False

    def start(self, session: Session) -> None:
        """Find the frames; start the source only if there are none."""
        self._n_played, self._is_closed, self.has_ended = 0, False, False
        self._key = _key_of(self._facts, session)
        package = type(self._source).__module__.partition(".")[0]
        self._archive = self._cache.find(self._key, package)
        if self._archive is None:
            self._source.start(session)
            self.drives_itself = self._source.drives_itself
        else:
            self.drives_itself = True

    def close(self) -> None:
        """End the frames."""
        self._is_closed = True
        self._source.close()

    @property
    def frames_key(self) -> str | None:
        """Digest of what its frames depend on, once it has started; None: they are those of this run alone."""
        return self._key if self.drives_itself else None

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        return self._source.sensors if self._archive is None else self._archive.sensors

    @property
    def accepts(self) -> frozenset[type[Command]]:
        if self._archive is None:
            return self._source.accepts
        return frozenset(getattr(commands, name) for name in self._archive.accepts)

    def drive(self, command: Command) -> None:
        """Hand a command on; frames that are played know none, and end with the run that sends a `Stop`."""
        if self._archive is None:
            self._source.drive(command)

    def frames(self) -> Iterator[Frame]:
        """Yield the frames."""
        if self._archive is not None:
            return self._play(self._archive)
        return self._play_and_record() if self.drives_itself else self._source.frames()

    def ground_truth(self) -> Trajectory | None:
        """Return the truth as far as frames were taken."""
        if self._archive is None:
            return self._source.ground_truth()
        truth, frames = self._archive.ground_truth, self._archive.frames
        if truth is None or self._n_played >= len(frames):
            return truth
        last_s = frames[self._n_played - 1].stamp_s if self._n_played else float("-inf")
        n = int((truth.stamps_s <= last_s).sum())
        return Trajectory(truth.stamps_s[:n], truth.poses[:n])

    def counters(self) -> Mapping[str, int]:
        """Return what the source had counted when it gave the last frame that was taken."""
        if self._archive is None:
            return self._source.counters()
        known = [counters for n, counters in self._archive.counters if n <= max(self._n_played, 1)]
        return known[-1] if known else {}

    def _play(self, archive: FrameArchive) -> Iterator[Frame]:
        for n, frame in enumerate(archive.frames, start=1):
            if self._is_closed:
                return
            self._n_played = n
            yield frame
        self._n_played = len(archive.frames) + 1  # it was asked for more, and counted once more
        self.has_ended = True

    def _play_and_record(self) -> Iterator[Frame]:
        recording = self._begin()
        try:
            for frame in self._source.frames():
                recording = self._keep(recording, frame)
                yield frame
            self.has_ended = not self._is_closed
            if recording is not None and self.has_ended:
                self._finish(recording)
        finally:
            if recording is not None:
                recording.abandon()

    def _begin(self) -> FrameRecording | None:
        try:
            return self._cache.record(self._key)
        except OSError as error:
            logger.debug("frames are not kept: %s", error)
            return None

    def _keep(self, recording: FrameRecording | None, frame: Frame) -> FrameRecording | None:
        """Write a frame; a run goes on without an archive where it cannot be written."""
        if recording is not None:
            try:
                recording.add(frame, self._source.counters())
            except (OSError, TypeError) as error:
                logger.debug("frames are not kept: %s", error)
                recording.abandon()
                return None
        return recording

    def _finish(self, recording: FrameRecording) -> None:
        accepts = tuple(sorted(command.__name__ for command in self._source.accepts))
        if not all(hasattr(commands, name) for name in accepts):
            return
        truth = self._source.ground_truth()
        facts = {"sensors": dict(self._source.sensors), "accepts": accepts, "ground_truth": truth}
        with suppress(OSError, TypeError):
            recording.commit(facts, self._source.counters())


def _key_of(facts: Mapping[str, Any], session: Session) -> str:
    """Return the digest of all that frames depend on."""
    told = {
        "name": session.name,
        "mode": session.mode,
        "path": None if session.path is None else to_plain_bytes(session.path.waypoints).decode(),
        "start": to_plain_bytes(session.start_pose).decode(),
        "sensors": to_plain_bytes(dict(session.sensors)).decode(),
        "rng": session.rng.bit_generator.state,
    }
    return digest_of({**facts, "session": told})
