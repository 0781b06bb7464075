"""Frames of simulated sources, rendered once: kept on disk by what they depend on, and played to every cell that asks.

An archive is a folder: ``frames.bin`` with the arrays, which is mapped into memory, and ``index.json`` with all else.
It is there as a whole or not at all. When all archives take too much, those go that were not used for longest.
"""

from __future__ import annotations

import mmap
import os
import shutil
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.frames import Frame, SensorInfo
from trailmark.geometry import Trajectory
from trailmark.isolation.limits import folder_mb
from trailmark.isolation.plain import from_plain_bytes, to_plain_bytes

__all__ = ["FrameArchive", "FrameCache", "FrameRecording"]

_ARRAYS = "frames.bin"
_INDEX = "index.json"
#: How the folders begin that are being removed.
_GONE = ".gone-"
# As memory is allocated, so that what runs over an array runs over it in the same way.
_ALIGNMENT = 64


@dataclass(frozen=True, slots=True, eq=False)
class FrameArchive:
    """All that a source gave in one run.

    Attributes
    ----------
    sensors : mapping of str to SensorInfo
        Its sensors.
    accepts : tuple of str
        Names of the commands that it takes.
    frames : sequence of Frame
        Arrays are mapped, and cannot be written to.
    counters : sequence of (int, mapping)
        What it counted, from so many frames on.
    ground_truth : Trajectory or None
        After the last frame.
    n_bytes : int
        Of the arrays.
    notes : mapping
        Plain data that who wrote it keeps beside.
    """

    sensors: Mapping[str, SensorInfo]
    accepts: tuple[str, ...]
    frames: Sequence[Frame] = field(repr=False)
    counters: Sequence[tuple[int, Mapping[str, int]]]
    ground_truth: Trajectory | None
    n_bytes: int
    notes: Mapping[str, Any] = field(default_factory=dict)


class FrameCache:
    """Archives of frames in a folder.

    Parameters
    ----------
    folder : Path
        It is made when it is needed.
    limit_mb : float
        What all archives may take together [MB].
    """

    def __init__(self, folder: Path, limit_mb: float) -> None:
        self._folder = folder
        self.limit_mb = limit_mb

    def find(self, key: str, package: str) -> FrameArchive | None:
        """Return the archive of a key; None if there is none, or it cannot be read.

        Parameters
        ----------
        key : str
            Digest of what the frames depend on.
        package : str
            Of the source: classes in the archive are of Trailmark or of it.
        """
        try:
            archive = _read(self.place_of(key), package)
        except (OSError, ValueError):
            return None
        self.mark_used(key)
        return archive

    def place_of(self, key: str) -> Path:
        """Return the folder of an archive, which may not be there."""
        return self._folder / key

    def draft_of(self, key: str) -> Path:
        """Return a folder of this process alone, to write an archive in before it is moved to its place."""
        return self._folder / f".{key}-{os.getpid()}-{time.monotonic_ns()}"

    def mark_used(self, key: str) -> None:
        """Note that an archive was used: the one that was used last goes last."""
        with suppress(OSError):
            os.utime(self.place_of(key))

    def record(self, key: str) -> FrameRecording:
        """Return the recording of an archive.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        return FrameRecording(self, self.draft_of(key), self.place_of(key))

    def remove(self, key: str) -> None:
        """Remove an archive, if there is one: it is gone at once as a whole, so that nobody finds half of it."""
        gone = self._folder / f"{_GONE}{key}-{os.getpid()}-{time.monotonic_ns()}"
        with suppress(OSError):
            self.place_of(key).rename(gone)
        shutil.rmtree(gone, ignore_errors=True)

    def make_room(self, needed_mb: float) -> None:
        """Remove the archives that were not used for longest, until there is room for another."""
        found = []
        for place in self._folder.iterdir():
            with suppress(OSError):
                found.append((place.stat().st_mtime, folder_mb(place), place))
        used_mb = sum(size_mb for _, size_mb, _ in found)
        for _, size_mb, place in sorted(found):
            if used_mb + needed_mb <= self.limit_mb:
                return
            if place.name.startswith(_GONE):  # who was to remove it did not come to its end
                shutil.rmtree(place, ignore_errors=True)
            elif place.name.startswith("."):  # somebody is at work there
                continue
            else:
                self.remove(place.name)
            used_mb -= size_mb


class FrameRecording:
    """Writes an archive; it is there after `commit`, and never if that is not called."""

    def __init__(self, cache: FrameCache, draft: Path, place: Path) -> None:
        self._cache = cache
        self._draft = draft
        self._place = place
        self._frames: list[bytes] = []
        self._counters: list[tuple[int, dict[str, int]]] = []
        self._n_bytes = 0
        draft.mkdir(parents=True)
        self._file = (draft / _ARRAYS).open("wb")

    def add(self, frame: Frame, counters: Mapping[str, int]) -> None:
        """Write the next frame, and what the source has counted until then.

        Raises
        ------
        OSError
            If it cannot be written, or would be larger than the whole cache.
        TypeError
            If there is something in it that cannot be kept.
        """
        self._frames.append(to_plain_bytes(frame, self._put))
        if not self._counters or self._counters[-1][1] != counters:
            self._counters.append((len(self._frames), dict(counters)))

    def commit(self, facts: Mapping[str, Any], counters: Mapping[str, int]) -> None:
        """Put the archive in its place, with the other facts of a `FrameArchive`; room is made for it.

        `counters` is what the source has counted after the last frame.
        """
        self._file.close()
        counted = [*self._counters, (len(self._frames) + 1, dict(counters))]
        facts = {**facts, "n_bytes": self._n_bytes, "counters": counted}
        index = b'{"facts":%s,"frames":[%s]}' % (to_plain_bytes(facts), b",".join(self._frames))
        (self._draft / _INDEX).write_bytes(index)
        for name in (_ARRAYS, _INDEX):
            (self._draft / name).chmod(0o444)
        self._cache.make_room(self._n_bytes / 1e6)
        with suppress(OSError):  # another process was first
            self._draft.rename(self._place)
        self.abandon()

    def abandon(self) -> None:
        """Remove what was written and not committed."""
        self._file.close()
        shutil.rmtree(self._draft, ignore_errors=True)

    def _put(self, array: AnyArray) -> list[Any]:
        if array.dtype.hasobject:
            raise TypeError(f"an array of {array.dtype} cannot be kept")
        if (self._n_bytes + array.nbytes) / 1e6 > self._cache.limit_mb:
            raise OSError("the frames would be larger than the cache")
        padding = -self._n_bytes % _ALIGNMENT
        self._file.write(bytes(padding))
        self._file.write(np.ascontiguousarray(array).tobytes())
        offset = self._n_bytes + padding
        self._n_bytes = offset + array.nbytes
        return [offset, array.dtype.str, list(array.shape)]


def _read(place: Path, package: str) -> FrameArchive:
    """Return an archive.

    Raises
    ------
    OSError, ValueError
        If it is not there, or not as it was written.
    """
    mapped = _map_file(place / _ARRAYS)

    def array(told: Any) -> AnyArray:
        offset, dtype, shape = told
        count = int(np.prod(shape, dtype=np.int64))
        return np.frombuffer(mapped, np.dtype(dtype), count, offset).reshape(shape)

    index = (place / _INDEX).read_bytes()
    head, separator, frames = index.partition(b',"frames":')
    if not separator:
        raise ValueError("the index has no frames")
    facts = from_plain_bytes(head.removeprefix(b'{"facts":'), package)
    found = from_plain_bytes(frames[:-1], package, array)
    archive = FrameArchive(frames=found, **facts)
    if archive.n_bytes != len(mapped):
        raise ValueError("the arrays are not as long as they were written")
    return archive


def _map_file(path: Path) -> mmap.mmap | bytes:
    with path.open("rb") as file:
        if not path.stat().st_size:
            return b""  # nothing can be mapped of an empty file
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
