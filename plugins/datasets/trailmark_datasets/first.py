"""The first frame of a recording: it is looked at before any is asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

from trailmark.config import SourceConfig
from trailmark.errors import SourceError

__all__ = ["first_readable"]

Item = TypeVar("Item")
Loaded = TypeVar("Loaded")


def first_readable(items: Iterable[Item], load: Callable[[Item], Loaded], config: SourceConfig) -> Loaded:
    """Return the first that can be loaded; what is unreadable before it is counted when its turn comes.

    Raises
    ------
    SourceError
        That of the first, where none can be, or none may be skipped.
    """
    errors: list[SourceError] = []
    for item in items:
        try:
            return load(item)
        except SourceError as error:
            errors.append(error)
            if config.on_bad_frame == "error":
                break
    raise errors[0]
