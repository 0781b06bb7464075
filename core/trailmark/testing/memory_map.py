"""A localizer map without a store."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.interfaces import LocalizerMap
from trailmark.paths import Keyframe

__all__ = ["MemoryMap"]


class MemoryMap(LocalizerMap):
    """A localizer map without a store: what goes in comes out as it was."""

    def __init__(self) -> None:
        self._keyframes: list[Keyframe] = []
        self._saved: dict[str, dict[str, AnyArray]] = {}

    def copy(self) -> MemoryMap:
        """Return another map of the same content: what is done to it does not change this one."""
        other = MemoryMap()
        other._keyframes = list(self._keyframes)
        for name, arrays in self._saved.items():
            other.save(name, arrays)
        return other

    def add(self, keyframe: Keyframe) -> None:
        """Remember a keyframe."""
        self._keyframes.append(keyframe)

    def keyframes(self) -> Sequence[Keyframe]:
        """Return all keyframes in the order in which they were added."""
        return tuple(self._keyframes)

    def save(self, name: str, arrays: Mapping[str, AnyArray]) -> None:
        """Store copies of named arrays under a name."""
        self._saved[name] = {key: np.array(array) for key, array in arrays.items()}

    def load(self, name: str) -> Mapping[str, AnyArray] | None:
        """Return the arrays saved under a name, or None."""
        return self._saved.get(name)

    @property
    def is_empty(self) -> bool:
        """Whether nothing was remembered."""
        return not self._keyframes and not self._saved
