"""Names that a person typed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError

from trailmark.plugins.hints import nearest_or_all

__all__ = ["unknown_name", "with_hints"]


def unknown_name(what: str, name: str, known: Iterable[str]) -> str:
    """Return the message for a name that nothing bears: what was asked, and the nearest or all there are."""
    return f"no {what} named {name!r}{nearest_or_all(name, sorted(known), f'{what}s')}"


def with_hints(error: ValidationError, model: type[BaseModel]) -> ValidationError:
    """Return the same errors; those about unknown keys name the nearest key, or all."""
    details = [_with_hint(item, model) for item in error.errors(include_url=False)]
    return ValidationError.from_exception_data(error.title, details)


def _with_hint(item: ErrorDetails, model: type[BaseModel]) -> InitErrorDetails:
    loc = item["loc"]
    if item["type"] == "extra_forbidden":
        story = f"unknown key{nearest_or_all(str(loc[-1]), _keys_at(model, loc[:-1]), 'keys')}"
        # Braces would be read as places for values.
        kind: Any = PydanticCustomError("unknown_key", story.replace("{", "{{").replace("}", "}}"))
    else:
        kind = item["type"]
    return InitErrorDetails(type=kind, loc=loc, input=item["input"], ctx=item.get("ctx", {}))


def _keys_at(annotation: Any, loc: Sequence[int | str]) -> list[str]:
    """Return the keys of the model that stands at a place within an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        fields = annotation.model_fields
        if not loc:
            return list(fields)
        return _keys_at(fields[str(loc[0])].annotation, loc[1:]) if loc[0] in fields else []
    inner = loc[1:] if loc and isinstance(loc[0], int) else loc
    parts = (_keys_at(part, inner) for part in getattr(annotation, "__args__", ()))
    return next((keys for keys in parts if keys), [])
