"""Pydantic's findings in our words, at the keys where they belong."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from trailmark.config.document import Key, Keys, Problems
from trailmark.config.files import BASE_DIR
from trailmark.plugins.hints import did_you_mean, nearest_or_all

__all__ = ["key_names", "validate_at"]

M = TypeVar("M", bound=BaseModel)

_TYPE_WORDS = {
    "dict_type": "a mapping",
    "list_type": "a list",
    "mapping_type": "a mapping",
    "model_attributes_type": "a mapping",
    "model_type": "a mapping",
    "path_type": "a path",
    "string_type": "text",
    "tuple_type": "a list",
}


def validate_at(
    model: type[M], data: Mapping[str, Any], keys: Keys, problems: Problems, base_dir: Any, also: Iterable[str] = ()
) -> M | None:
    """Validate data that stands at some keys; note what is wrong with it.

    Parameters
    ----------
    model : type
        A pydantic model.
    data : mapping
        What was written.
    keys : tuple
        Where it was written.
    problems : Problems
        Takes what is wrong.
    base_dir : Path
        Where relative paths start.
    also : iterable of str
        Keys that are right at this place without being the model's: offered as the nearest right name.

    Returns
    -------
    model or None
        None if anything is wrong.
    """
    try:
        return model.model_validate(dict(data), context={BASE_DIR: base_dir})
    except ValidationError as error:
        found = [(_path_in(data, details), details) for details in error.errors(include_url=False)]
        wanted: dict[Keys, list[str]] = {}
        typed = {path for path, details in found if _is_type(details)}
        for path, details in _telling(found):
            if _is_type(details) or (path in typed and _is_far_from_words(details)):  # branches of a union
                wanted.setdefault(path, []).append(_type_words(details))
            else:
                problems.add(keys + path, _words(details, path, model, also))
        inputs = {path: details["input"] for path, details in found}
        for path, types in wanted.items():
            problems.add(keys + path, f"must be {' or '.join(dict.fromkeys(types))}, not {_as_text(inputs[path])}")
        return None


def key_names(model: type[BaseModel]) -> list[str]:
    """Return the keys that a model takes at its top, as they are written."""
    return [info.alias or name for name, info in model.model_fields.items()]


def _path_in(data: Any, details: ErrorDetails) -> Keys:
    """Keep the keys that stand in the data: pydantic adds the names of union branches and validators."""
    path: list[Key] = []
    for part in details["loc"]:
        if _has(data, part):
            path.append(part)
            data = data[part]
    return tuple(path)


def _has(data: Any, part: Key) -> bool:
    if isinstance(data, Mapping):
        return part in data
    return isinstance(data, list | tuple) and isinstance(part, int) and part < len(data)


def _telling(found: list[tuple[Keys, ErrorDetails]]) -> list[tuple[Keys, ErrorDetails]]:
    """Of the branches of a union, keep the finding that fits what was meant.

    A branch that stumbles over the value as a whole says less than one that found a wrong key or value in it.
    """
    kept = []
    for path, details in found:
        says_more = any(
            other is not details and path == where[: len(path)] and (where != path or not _is_branch(other))
            for where, other in found
        )
        if not (_is_branch(details) and says_more) and not _is_misspelt(path, details, found):
            kept.append((path, details))
    return kept


def _is_misspelt(path: Keys, details: ErrorDetails, found: list[tuple[Keys, ErrorDetails]]) -> bool:
    """Whether a missing key stands there under a similar name: the message about the unknown key is then enough."""
    if details["type"] != "missing":
        return False
    unknown = [str(at[-1]) for at, other in found if other["type"] == "extra_forbidden" and at[:-1] == path]
    return any(did_you_mean(name, [str(details["loc"][-1])]) for name in unknown)


def _is_type(details: ErrorDetails) -> bool:
    return details["type"].endswith(("_type", "_parsing", "_from_float"))


def _is_branch(details: ErrorDetails) -> bool:
    """Whether a branch of a union finds that a value is not meant for it."""
    return _is_type(details) or _is_far_from_words(details)


def _is_far_from_words(details: ErrorDetails) -> bool:
    """Whether a value is none of some words, and not a misspelt one either."""
    if details["type"] != "literal_error":
        return False
    return not did_you_mean(str(details["input"]), _choices(details))


def _choices(details: ErrorDetails) -> list[str]:
    return str(details["ctx"]["expected"]).split("'")[1::2]


def _words(details: ErrorDetails, path: Keys, model: type[BaseModel], also: Iterable[str]) -> str:
    match details["type"]:
        case "extra_forbidden":
            known = _keys_at(model, path[:-1]) + (list(also) if len(path) == 1 else [])
            return f"unknown key{nearest_or_all(str(path[-1]), known, 'keys')}"
        case "invalid_key":
            return "a key must be text"
        case "missing" if isinstance(details["loc"][-1], int):
            return f"the list is too short: item {details['loc'][-1] + 1} is missing"
        case "missing":
            return f"missing key {str(details['loc'][-1])!r}"
        case "value_error":
            return str(details["ctx"]["error"])
        case "literal_error" | "enum":
            hint = did_you_mean(str(details["input"]), _choices(details))
            return f"must be {details['ctx']['expected']}, not {_as_text(details['input'])}{hint}"
    message = details["msg"]
    if message.startswith("Input should "):
        return f"must {message.removeprefix('Input should ')}, not {_as_text(details['input'])}"
    return message[:1].lower() + message[1:]


def _type_words(details: ErrorDetails) -> str:
    words = _TYPE_WORDS.get(details["type"])
    if words is not None:
        return words
    if details["type"] == "literal_error":
        return str(details["ctx"]["expected"])
    told = details["msg"].removeprefix("Input should be ")
    return re.split(r", (?:unable|got) ", told)[0]


def _as_text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()  # as configs write it
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, list | tuple) and len(repr(value)) > 40:
        return f"a list of {len(value)}"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _keys_at(model: type[BaseModel], path: Keys) -> list[str]:
    """Return the keys that are right at a place within a model."""
    models = [model]
    for key in path:
        fields = [info for each in models for name, info in each.model_fields.items() if (info.alias or name) == key]
        if fields:  # anything else is an index or a key of a plain mapping, of the same model
            models = [inner for info in fields for inner in _models_in(info.annotation)]
    return [name for each in models for name in key_names(each)]


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for argument in get_args(annotation) for model in _models_in(argument)]
