"""What stands in a taught path."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from trailmark.arrays import AnyArray
from trailmark.interfaces import PathStore, Session
from trailmark.paths import Keyframe
from trailmark.paths import Path as TaughtPath

__all__ = ["arrays_of", "keyframes_of", "path_of"]


@contextmanager
def _open_store(store: Path) -> Iterator[PathStore]:
    from trailmark.api import create

    opened: PathStore = create("path_store", "sqlite", path=str(store), access="read")
    opened.start(Session(mode="replay"))
    try:
        yield opened
    finally:
        opened.close()


def keyframes_of(store: Path, owner: str) -> list[Keyframe]:
    """Return what a localizer remembered while teaching."""
    with _open_store(store) as opened:
        return list(opened.localizer_map(owner).keyframes())


def arrays_of(store: Path, owner: str, name: str) -> Mapping[str, AnyArray]:
    """Return arrays that a localizer saved while teaching."""
    with _open_store(store) as opened:
        saved = opened.localizer_map(owner).load(name)
    assert saved is not None
    return saved


def path_of(store: Path) -> TaughtPath:
    """Return the taught path."""
    with _open_store(store) as opened:
        path = opened.path()
    assert path is not None
    return path
