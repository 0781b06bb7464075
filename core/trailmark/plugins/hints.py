"""The nearest right name, for messages."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

__all__ = ["did_you_mean", "nearest_or_all"]


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``" (did you mean 'x'?)"`` for the nearest known name, or nothing when none is near."""
    close = get_close_matches(name, list(known), n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""


def nearest_or_all(name: str, known: Iterable[str], label: str) -> str:
    """Return the nearest known name as `did_you_mean` does, or all of them: ``"; keys: x, y"``."""
    names = list(known)
    return did_you_mean(name, names) or f"; {label}: {', '.join(names) or 'none'}"
