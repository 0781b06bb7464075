"""The nearest right name, for messages."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

__all__ = ["did_you_mean", "nearest_or_all"]


#: So many names can be read at one glance; of more only the nearest are told, three that are as alike as this.
_MOST_NAMES = 40
_ALIKE = 0.5


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``" (did you mean 'x'?)"`` for the nearest known name, or nothing when none is near."""
    close = get_close_matches(name, list(known), n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""


def nearest_or_all(name: str, known: Iterable[str], label: str) -> str:
    """Return the nearest known name as `did_you_mean` does, or all of them: ``"; keys: x, y"``.

    Where there are more than anybody reads, three that are near, if any are: ``"; nearest of 86 keys: x, y, z"``.
    """
    names = list(known)
    if hint := did_you_mean(name, names):
        return hint
    if len(names) > _MOST_NAMES:
        nearest = get_close_matches(name, names, n=3, cutoff=_ALIKE)
        among = f"{len(names)} {label}"
        return f"; nearest of {among}: {', '.join(nearest)}" if nearest else f"; there are {among}"
    return f"; {label}: {', '.join(names) or 'none'}"
