"""Names of localizers in the configs of other parts: a name that no localizer has changes nothing, and is told."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, get_args

from trailmark.config.document import Document
from trailmark.config.entries import PartEntry
from trailmark.plugins.hints import nearest_or_all

__all__ = ["LocalizerName", "notices_of_strangers"]


@dataclass(frozen=True, slots=True)
class _IsLocalizer:
    """Marks a text that is the name of a localizer."""


LocalizerName = Annotated[str, _IsLocalizer()]
"""The name of a localizer; as the key of a mapping (``dict[LocalizerName, X]``) it is checked against those there are.

A name that no localizer has is no error: a bench leaves localizers out, cell by cell.
"""


def notices_of_strangers(
    parts: Iterable[PartEntry[Any]], localizers: Collection[str], document: Document
) -> Iterator[str]:
    """Yield a line for each name in a config that no localizer has."""
    for part in parts:
        for name, field in type(part.config).model_fields.items():
            value = getattr(part.config, name)
            if not isinstance(value, Mapping) or not _names_localizers(field.annotation):
                continue
            for key in value:
                if key not in localizers:
                    place = document.place((*part.keys, name, key))
                    hint = nearest_or_all(key, localizers, "localizers")
                    yield f"{place}: no localizer is called {key!r}{hint}, so this changes nothing"


def _names_localizers(annotation: object) -> bool:
    keys = get_args(annotation)[:1]
    return any(isinstance(mark, _IsLocalizer) for key in keys for mark in getattr(key, "__metadata__", ()))
