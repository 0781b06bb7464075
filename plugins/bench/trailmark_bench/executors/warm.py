"""Warm processes for cells that are alike: of the same packages and parts, with as many threads."""

from __future__ import annotations

import logging
import threading
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

from trailmark.isolation.fingerprint import digest_of
from trailmark.isolation.warm_parent import WarmParent
from trailmark_bench.process import CELL_MODULE

__all__ = ["WarmParents"]

logger = logging.getLogger(__name__)

# The pages of what all have imported are shared. The grand bench has some 40 kinds of cells, and meets each again for
# every place and seed.
_MOST = 64
# What is lost as often is not begun again: what it imports may be what ends it, at every cell.
_MOST_LOST = 5


class WarmParents:
    """The processes that cells are forked from, one for each set of parts; from several threads.

    They are forked themselves, from one that has imported what all cells need. One that is lost, with its origin or
    alone, costs a cell its quick start, and is begun again for the next.
    """

    def __init__(self) -> None:
        self._parents: dict[str, WarmParent] = {}
        self._origins: dict[int | None, WarmParent] = {}
        self._lost_origins: list[WarmParent] = []
        self._n_lost: Counter[str] = Counter()
        self._lock = threading.Lock()

    def of(self, request: Mapping[str, Any]) -> WarmParent | None:
        """Return the process that has imported what a cell needs; None where processes cannot be forked so."""
        if not WarmParent.is_possible():
            return None
        threads, plugins = request["limits"]["threads"], request["plugins"]
        parts = sorted({*_parts_in(request["document"]), *_parts_in(request["teach"])})
        key = digest_of({"code": sorted(request["code"]), "parts": parts, "threads": threads, "plugins": plugins})
        with self._lock:
            parent = self._parents.pop(key, None)
            if parent is None or self._is_begun_again(key, parent):
                parent = WarmParent(CELL_MODULE, threads, self._origin(threads))
            self._parents[key] = parent  # the one that was asked for last stands last
            self._end_oldest()
        return parent

    def close(self) -> None:
        """End all of them."""
        with self._lock:
            parents = [*self._parents.values(), *self._origins.values(), *self._lost_origins]
            self._parents, self._origins, self._lost_origins = {}, {}, []
        for parent in parents:
            parent.close()

    def _is_begun_again(self, key: str, parent: WarmParent) -> bool:
        """Return whether another takes the place of a parent, which is lost and has not been so too often."""
        if not parent.is_lost or self._n_lost[key] >= _MOST_LOST:
            return False
        parent.close()
        self._n_lost[key] += 1
        if self._n_lost[key] == _MOST_LOST:
            logger.warning("a process that cells are forked from was lost %d times, and is begun once more", _MOST_LOST)
        return True

    def _origin(self, threads: int | None) -> WarmParent:
        """Return the process that others with so many threads are forked from; another where it is lost."""
        origin = self._origins.get(threads)
        if origin is not None and origin.is_lost:
            self._lost_origins.append(origin)  # not closed yet: should it only be stuck, cells of its children run on
            origin = None
        if origin is None:
            origin = self._origins[threads] = WarmParent(CELL_MODULE, threads)
        return origin

    def _end_oldest(self) -> None:
        idle = [key for key, parent in list(self._parents.items())[:-1] if parent.is_idle]
        for key in idle[: max(0, len(self._parents) - _MOST)]:
            self._parents.pop(key).close()


def _parts_in(document: Any) -> Iterator[str]:
    """Yield the names of the plugins that a config takes its parts from."""
    if isinstance(document, Mapping):
        for key, value in document.items():
            if key == "plugin" and isinstance(value, str):
                yield value
            yield from _parts_in(value)
    elif isinstance(document, list):
        for value in document:
            yield from _parts_in(value)
