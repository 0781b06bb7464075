"""What a localizer keeps in the store: its format beside it, and its stations when a path is continued."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.errors import StoreError
from trailmark.interfaces import Localizer, LocalizerMap
from trailmark.paths import Keyframe

__all__ = ["FORMAT_NAME", "ContinuedMap", "VersionedMap", "check_format"]

#: Under this name a localizer map tells the format of what is in it.
FORMAT_NAME = "map_format"

_KEY = "version"


class VersionedMap(LocalizerMap):
    """A localizer map that stores its format with its first content; an empty map has no format.

    Parameters
    ----------
    localizer_map : LocalizerMap
        Where it is kept.
    version : int
        The localizer's `map_format`.
    """

    def __init__(self, localizer_map: LocalizerMap, version: int) -> None:
        self._localizer_map = localizer_map
        self._version = version
        self._is_told = localizer_map.load(FORMAT_NAME) is not None

    def add(self, keyframe: Keyframe) -> None:
        """Remember a keyframe."""
        self._tell()
        self._localizer_map.add(keyframe)

    def keyframes(self) -> Sequence[Keyframe]:
        """Return all keyframes."""
        return self._localizer_map.keyframes()

    def save(self, name: str, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Store named arrays."""
        self._tell()
        self._localizer_map.save(name, arrays)

    def load(self, name: str) -> Mapping[str, npt.NDArray[Any]] | None:
        """Return the arrays saved under a name, or None."""
        return self._localizer_map.load(name)

    def _tell(self) -> None:
        if not self._is_told:
            self._localizer_map.save(FORMAT_NAME, {_KEY: np.array(self._version, np.int64)})
            self._is_told = True


class ContinuedMap(LocalizerMap):
    """A localizer map of a path that is being continued: stations go on where the path ended.

    Parameters
    ----------
    localizer_map : LocalizerMap
        The map of the store.
    offset_m : float
        Length of the path before this teaching [m].
    """

    def __init__(self, localizer_map: LocalizerMap, offset_m: float) -> None:
        self._localizer_map = localizer_map
        self._offset_m = offset_m

    def add(self, keyframe: Keyframe) -> None:
        """Remember a keyframe."""
        self._localizer_map.add(replace(keyframe, station_m=keyframe.station_m + self._offset_m))

    def keyframes(self) -> Sequence[Keyframe]:
        """Return all keyframes, those of the whole path."""
        return self._localizer_map.keyframes()

    def save(self, name: str, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Store named arrays."""
        self._localizer_map.save(name, arrays)

    def load(self, name: str) -> Mapping[str, npt.NDArray[Any]] | None:
        """Return the arrays saved under a name, or None."""
        return self._localizer_map.load(name)


def check_format(localizer_map: LocalizerMap, name: str, localizer: Localizer, is_continued: bool = False) -> None:
    """Refuse the map of a newer localizer; a map without a format was written before formats were stored.

    Parameters
    ----------
    localizer_map : LocalizerMap
        What is remembered.
    name : str
        The localizer's name in the config.
    localizer : Localizer
        Who is to read it.
    is_continued : bool
        Teaching goes on: then an older format is refused too, one localizer map holds one.

    Raises
    ------
    StoreError
        If the format is newer than the localizer's own, or none at all.
    """
    told = localizer_map.load(FORMAT_NAME)
    if told is None:
        return
    version, own = told.get(_KEY), localizer.map_format
    if version is None or version.shape != () or version.dtype.kind != "i" or version < 1:
        raise StoreError(f"localizer {name!r}: what it remembers of this path does not tell its format")
    if version > own:
        raise StoreError(
            f"localizer {name!r}: what it remembers of this path has format {version}, newer than {own}, which this"
            " version reads: update the plugin that brings it, or teach the path again"
        )
    if is_continued and version < own:
        raise StoreError(
            f"localizer {name!r}: what it remembers of this path has format {version}, and this version writes {own}:"
            " teach the path again instead of going on with it"
        )
