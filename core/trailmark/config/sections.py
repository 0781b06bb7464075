"""Where in a config the parts stand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from trailmark.config.document import Keys
from trailmark.plugins.spec import Kind

__all__ = ["NAMED_SECTIONS", "SINGLE_SECTIONS", "expand_shorthand", "kind_at"]

#: Sections that hold parts by name.
NAMED_SECTIONS: dict[str, Kind] = {"sources": "source", "localizers": "localizer"}

#: Sections that are one part.
SINGLE_SECTIONS: tuple[Kind, ...] = ("estimator", "path_store", "controller")


def kind_at(keys: Keys) -> Kind | None:
    """Return the kind of the part that stands at some keys, None where none does."""
    match keys:
        case (str(section), _) if section in NAMED_SECTIONS:
            return NAMED_SECTIONS[section]
        case ("sinks", int()):
            return "sink"
        case (section,):
            return next((kind for kind in SINGLE_SECTIONS if kind == section), None)
    return None


def expand_shorthand(data: dict[str, Any]) -> None:
    """Write ``{plugin: NAME}`` wherever a part is given by its plugin's name alone; in place."""
    for holder, key in list(_places(data)):
        if isinstance(holder[key], str):
            holder[key] = {"plugin": holder[key]}


def _places(data: dict[str, Any]) -> Iterator[tuple[Any, Any]]:
    for kind in SINGLE_SECTIONS:
        if kind in data:
            yield data, kind
    for section in NAMED_SECTIONS:
        parts = data.get(section)
        if isinstance(parts, Mapping):
            yield from ((parts, name) for name in parts)
    sinks = data.get("sinks")
    if isinstance(sinks, list):
        yield from ((sinks, index) for index in range(len(sinks)))
