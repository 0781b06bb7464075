"""``--set a.b.c=value``."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import replace
from typing import Any

from trailmark.config.document import Document, Key, Keys, TextError, expand_shorthand, kind_at
from trailmark.config.explain import key_names
from trailmark.config.host import DEFAULT_PLUGINS, HOST_OPTIONS
from trailmark.errors import ConfigError, PluginError
from trailmark.plugins import Kind, Registry

__all__ = ["Override", "with_overrides"]

#: ``"a.b.c=value"`` with the value in YAML, or the keys and a value that is taken as it is.
Override = str | tuple[str, Any]


def with_overrides(
    document: Document, overrides: Sequence[Override], registry: Registry
) -> tuple[Document, tuple[str, ...]]:
    """Return a document with values set, and what there is to say about it.

    Another plugin for a part drops the keys that only the old plugin knew; a notice names them.

    Raises
    ------
    ConfigError
        If an override has no value, or its keys lead through something that has no keys.
    """
    data = document.expanded().data
    notices: list[str] = []
    paths: list[Keys] = []
    for override in overrides:
        text, keys, value = _parse(override)
        holder, path = _walk(data, keys, text)
        kind = kind_at(path[:-1])
        if path[-1] == "plugin" and kind is not None:
            notices += _drop_foreign_keys(holder, kind, value, path, registry)
        holder[path[-1]] = value
        expand_shorthand(data)
        paths.append(path)
    return replace(document, data=data, overridden=(*document.overridden, *paths)), tuple(notices)


def _parse(override: Override) -> tuple[str, list[str], Any]:
    """Return how messages call it, its keys and its value."""
    if not isinstance(override, str):
        key, value = override
        return f"--set {key}", key.split("."), deepcopy(value)
    key, equals, text = override.partition("=")
    keys = [part.strip() for part in key.split(".")]
    if not equals or not all(keys):
        raise ConfigError(f"--set {override}: write KEY=VALUE, for example --set localizers.floor.plugin=klt")
    from trailmark.config.yaml_text import parse_value

    try:
        return f"--set {override}", keys, parse_value(text)
    except TextError as error:
        raise ConfigError(f"--set {override}: {error}") from error


def _walk(data: dict[str, Any], keys: Sequence[str], text: str) -> tuple[Any, Keys]:
    """Return the mapping or list that holds the last key, and the keys with indices as numbers."""
    node: Any = data
    path: list[Key] = []
    for depth, key in enumerate(keys):
        step = _step(node, key, path, text)
        path.append(step)
        if depth == len(keys) - 1:
            break
        if isinstance(node, dict) and node.get(key) is None:
            node[key] = {}
        node = node[step]
    return node, tuple(path)


def _step(node: Any, key: str, path: Sequence[Key], text: str) -> Key:
    if isinstance(node, dict):
        return key
    place = ".".join(str(part) for part in path)
    if not isinstance(node, list):
        raise ConfigError(f"{text}: {place} is {node!r}, which has no keys")
    if not (key.isdecimal() and int(key) < len(node)):
        raise ConfigError(f"{text}: {place} is a list of {len(node)}; its items are 0 to {len(node) - 1}, not {key}")
    return int(key)


def _drop_foreign_keys(part: dict[str, Any], kind: Kind, new: Any, path: Keys, registry: Registry) -> list[str]:
    """Drop the keys that only the old plugin knew; keys that neither knows stay, to be refused later."""
    old = part.get("plugin", DEFAULT_PLUGINS.get(kind))
    new_keys = _keys_of(kind, new, registry)
    if new_keys is None or old == new:
        return []
    kept = {"plugin", *key_names(HOST_OPTIONS[kind]), *new_keys}
    old_keys = _keys_of(kind, old, registry)
    dropped = [key for key in part if key not in kept and (old_keys is None or key in old_keys)]
    for key in dropped:
        del part[key]
    place = ".".join(str(key) for key in path[:-1])
    return [f"{place}: dropped {', '.join(dropped)}, which {new!r} does not know"] if dropped else []


def _keys_of(kind: Kind, plugin: Any, registry: Registry) -> list[str] | None:
    try:
        return key_names(registry.find(kind, str(plugin)).load_config())
    except PluginError:  # said where the part is read
        return None
