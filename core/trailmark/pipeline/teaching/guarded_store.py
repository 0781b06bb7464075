"""A path store whose failures name it, and say whether the run failed or the request was wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy.typing as npt

from trailmark.errors import StoreError, StoreFailedError
from trailmark.failures import call_guarded, raise_failure
from trailmark.frames import SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import LocalizerMap, PathStore
from trailmark.paths import Keyframe, Path, Waypoint

__all__ = ["GuardedMap", "GuardedStore"]

_PART = "the path store"


class GuardedStore(PathStore):
    """A path store as the run calls it: what reading raises is the store's own error, what writing raises ends the run.

    Parameters
    ----------
    store : PathStore
        Open and started.
    """

    def __init__(self, store: PathStore) -> None:
        super().__init__(None)
        self._store = store

    def close(self) -> None:
        """Close it."""
        call_guarded(_PART, "close", self._store.close)

    def path(self) -> Path | None:
        """Return the committed path."""
        return call_guarded(_PART, "path", self._path)

    def sensors(self) -> Mapping[str, SensorInfo]:
        """Return the sensors that it was taught with."""
        return call_guarded(_PART, "sensors", lambda: dict(self._store.sensors()))

    def is_finished(self, owner: str) -> bool:
        """Return whether a localizer has finished."""
        return call_guarded(_PART, "is_finished", lambda: self._store.is_finished(owner))

    def localizer_map(self, owner: str) -> LocalizerMap:
        """Return the map of one localizer."""
        return call_guarded(_PART, "localizer_map", lambda: self._localizer_map(owner))

    def append(self, waypoint: Waypoint) -> None:
        """Add a waypoint."""
        _write("append", lambda: self._store.append(waypoint))

    def commit(self) -> None:
        """Make everything so far durable."""
        _write("commit", self._store.commit)

    def owners(self) -> tuple[str, ...]:
        """Return whose localizer maps there are."""
        return call_guarded(_PART, "owners", lambda: tuple(self._store.owners()))

    def move(self, waypoints: Sequence[Pose2], keyframes: Mapping[str, Sequence[Keyframe]]) -> bool:
        """Put the path and what is remembered along it elsewhere."""
        moved: list[bool] = []
        _write("move", lambda: moved.append(bool(self._store.move(waypoints, keyframes))))
        return moved[0]

    def mark_finished(self, owner: str) -> None:
        """Write down that a localizer has finished."""
        _write("mark_finished", lambda: self._store.mark_finished(owner))

    def set_sensors(self, sensors: Mapping[str, SensorInfo]) -> None:
        """Keep the sensors."""
        _write("set_sensors", lambda: self._store.set_sensors(sensors))

    def set_meta(self, meta: Mapping[str, Any]) -> None:
        """Keep provenance."""
        _write("set_meta", lambda: self._store.set_meta(meta))

    def _path(self) -> Path | None:
        path = self._store.path()
        if path is not None and not isinstance(path, Path):
            raise TypeError(f"it returned {type(path).__name__}, not a Path")
        return path

    def _localizer_map(self, owner: str) -> LocalizerMap:
        localizer_map = self._store.localizer_map(owner)
        if not isinstance(localizer_map, LocalizerMap):
            raise TypeError(f"it returned {type(localizer_map).__name__}, not a LocalizerMap")
        return localizer_map


class GuardedMap(LocalizerMap):
    """A localizer map that is being written: what fails in it is the store's failure, not the localizer's.

    Parameters
    ----------
    localizer_map : LocalizerMap
        The map of the store.
    """

    def __init__(self, localizer_map: LocalizerMap) -> None:
        self._localizer_map = localizer_map

    def add(self, keyframe: Keyframe) -> None:
        """Remember a keyframe."""
        with _blamed_on_the_store("add"):
            self._localizer_map.add(keyframe)

    def keyframes(self) -> Sequence[Keyframe]:
        """Return all keyframes."""
        return self._localizer_map.keyframes()

    def save(self, name: str, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Store named arrays."""
        with _blamed_on_the_store("save"):
            self._localizer_map.save(name, arrays)

    def load(self, name: str) -> Mapping[str, npt.NDArray[Any]] | None:
        """Return the arrays saved under a name, or None."""
        return self._localizer_map.load(name)


def _write(method: str, call: Callable[[], None]) -> None:
    try:
        call()
    except BaseException as error:
        raise_failure(error, _PART, method, kind=StoreFailedError, keeps=())


@contextmanager
def _blamed_on_the_store(method: str) -> Iterator[None]:
    """Turn what a store cannot write into its own failure; what the localizer gave it wrongly stays the localizer's."""
    try:
        yield
    except (StoreError, OSError) as error:
        raise_failure(error, _PART, method, kind=StoreFailedError, keeps=())
