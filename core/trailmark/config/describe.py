"""A part's keys in words, for people."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from trailmark.config.base import SourceConfig
from trailmark.config.explain import key_names
from trailmark.config.host import HOST_OPTIONS
from trailmark.config.schema import Schema, part_schema
from trailmark.plugins import Spec

__all__ = ["KeyInfo", "describe_part"]

_BOUNDS = {"exclusiveMinimum": ">", "minimum": ">=", "exclusiveMaximum": "<", "maximum": "<="}
_TYPES = {"boolean": "true|false", "object": "mapping", "string": "text"}


@dataclass(frozen=True, slots=True)
class KeyInfo:
    """One key of a config.

    Attributes
    ----------
    key : str
        As it is written; keys within keys are joined by dots.
    type : str
        What may stand there, with its bounds.
    is_required : bool
        It has no default.
    default : object
        The default, as JSON would have it.
    description : str
        What it means.
    is_shared : bool
        The same for every part of this kind.
    """

    key: str
    type: str
    is_required: bool
    default: Any
    description: str
    is_shared: bool = False


def describe_part(spec: Spec) -> list[KeyInfo]:
    """Return the keys of a part: its own, then those that all parts of its kind have.

    Raises
    ------
    PluginLoadError
        If its config cannot be imported.
    """
    schema = part_schema(spec)
    theirs = _shared_keys(spec)
    keys = _keys(schema, schema["$defs"], "", theirs)
    return sorted((info for info in keys if info.key != "plugin"), key=lambda info: info.is_shared)


def _shared_keys(spec: Spec) -> set[str]:
    shared = key_names(HOST_OPTIONS[spec.kind]) if spec.kind in HOST_OPTIONS else []
    return {*shared, *(key_names(SourceConfig) if spec.kind == "source" else ())}


def _keys(schema: Schema, defs: Schema, prefix: str, shared: set[str]) -> list[KeyInfo]:
    found: list[KeyInfo] = []
    for name, inner in schema.get("properties", {}).items():
        key = prefix + name
        is_required = name in schema.get("required", [])
        told = " ".join(inner.get("description", "").split())
        is_shared = key.partition(".")[0] in shared
        found.append(KeyInfo(key, _type(inner, defs), is_required, inner.get("default"), told, is_shared))
        model = _model(inner, defs)
        if model is not None:
            found += _keys(model, defs, f"{key}.", shared)
    return found


def _model(schema: Schema, defs: Schema) -> Schema | None:
    """Return the model that stands within a key, if one does."""
    for choice in (schema, *schema.get("anyOf", []), *schema.get("allOf", [])):
        target = _target(choice, defs)
        if target is not choice and "properties" in target:
            return target
    return None


def _type(schema: Schema, defs: Schema) -> str:
    target = _target(schema, defs)
    if "anyOf" in target:
        choices = dict.fromkeys(_type(choice, defs) for choice in target["anyOf"])
        return " | ".join(choice for choice in choices if choice != "null")
    if "oneOf" in target:  # several models, told apart by a key of theirs
        return " | ".join(dict.fromkeys(_type(choice, defs) for choice in target["oneOf"]))
    if "const" in target:
        return str(target["const"])
    if "enum" in target:
        return " | ".join(str(value) for value in target["enum"])
    kind = target.get("type", "anything")
    if kind == "array":
        return _array(target, defs)
    if kind == "string" and target.get("format") in ("path", "file-path", "directory-path"):
        return "path"
    bounds = " ".join(f"{sign} {target[key]:g}" for key, sign in _BOUNDS.items() if key in target)
    return f"{_TYPES.get(kind, kind)} {bounds}".strip()


def _array(schema: Schema, defs: Schema) -> str:
    if "prefixItems" in schema:
        return f"[{', '.join(_type(item, defs) for item in schema['prefixItems'])}]"
    return f"list of {_type(schema.get('items', {}), defs)}"


def _target(schema: Schema, defs: Schema) -> Schema:
    reference = schema.get("$ref")
    found: Schema = schema if reference is None else defs[reference.rpartition("/")[2]]
    return found
