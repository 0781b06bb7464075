"""Names that a person typed."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

__all__ = ["did_you_mean", "unknown_name"]


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean 'street'?"`` for a near miss, else an empty string."""
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f"; did you mean {near[0]!r}?" if near else ""


def unknown_name(what: str, name: str, known: Iterable[str]) -> str:
    """Return the message for a name that nothing bears: what was asked, the nearest, what there is."""
    names = sorted(known)
    listed = ", ".join(names) if names else "none"
    return f"no {what} named {name!r}{did_you_mean(name, names)} (there are: {listed})"
