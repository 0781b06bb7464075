"""Configs grown from the program's own schema, and then made wrong in their structure."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from copy import deepcopy
from typing import Any

import numpy as np

__all__ = ["Grower", "as_toml", "as_yaml", "spoil_document"]

Rng = np.random.Generator
Node = dict[str, Any]

_STRINGS = (
    "",
    "x",
    "wheels",
    "floor",
    "true",
    "no",
    "1 m",
    "10cm",
    "3,5",
    "nan",
    "../..",
    "/dev/null",
    "${HOME}",
    "~",
    "a b",
)
_WRONG = (
    *(None, True, -1, 0, 1e-320, 1e308, math.nan, math.inf, -math.inf, 10**30, "", "10 cm", "0x10", "1e3", "\u0661"),
    *(
        [],
        {},
        [[]],
        {"a": None},
        {"": 1},
        ["x"] * 50,
        [1, "2", None],
        "\x00",
        "\ud7ff",
        "a" * 3000,
        "<<",
        "&a",
        "*a",
        "!!python/none",
    ),
)
_KEYS = (
    "plugn",
    "pluginn",
    "",
    " ",
    "a.b",
    "x" * 300,
    "path ",
    "\u0131d",
    "__class__",
    "0",
    "null",
    "true",
    "<<",
    "use",
)


class Grower:
    """Makes values that a schema allows.

    Parameters
    ----------
    schema : dict
        JSON schema of a config, with its ``$defs``.
    files : sequence of str
        Names for strings that are paths.
    """

    def __init__(self, schema: Node, files: tuple[str, ...]) -> None:
        self._definitions: Node = schema.get("$defs", {})
        self._files = files

    def names(self, kind: str) -> list[str]:
        """Return what there is of a kind of part: ``localizer``, ``sink`` ..."""
        return [
            name.partition(".")[2] for name in self._definitions if name.startswith(f"{kind}.") and name.count(".") == 1
        ]

    def part(self, kind: str, name: str, rng: Rng, density: float = 0.25) -> Node:
        """Return the section of a part, with some of its options."""
        found = self._grown(self._definitions[f"{kind}.{name}"], rng, density, 0)
        return {**found, "plugin": name} if isinstance(found, dict) else {"plugin": name}

    def _grown(self, node: Any, rng: Rng, density: float, depth: int, name: str = "") -> Any:
        if not isinstance(node, dict) or depth > 6:
            return None
        if "$ref" in node:
            return self._grown(self._definitions[node["$ref"].rpartition("/")[2]], rng, density, depth + 1, name)
        for several in ("anyOf", "oneOf", "allOf"):
            if several in node:
                chosen = node[several][int(rng.integers(len(node[several])))]
                return self._grown(chosen, rng, density, depth + 1, name)
        if "const" in node:
            return node["const"]
        if "enum" in node:
            return node["enum"][int(rng.integers(len(node["enum"])))]
        makers: dict[str, Callable[[], Any]] = {
            "object": lambda: self._object(node, rng, density, depth),
            "array": lambda: self._array(node, rng, density, depth),
            "string": lambda: str(rng.choice(self._files if "path" in name or "truth" in name else _STRINGS)),
            "boolean": lambda: bool(rng.random() < 0.5),
            "integer": lambda: round(_number(node, rng)),
            "number": lambda: _number(node, rng),
            "null": lambda: None,
        }
        return makers.get(str(node.get("type")), lambda: None)()

    def _object(self, node: Node, rng: Rng, density: float, depth: int) -> Node:
        properties: Node = node.get("properties", {})
        needed = set(node.get("required", ()))
        chosen = [key for key in properties if key in needed or rng.random() < density]
        grown = {key: self._grown(properties[key], rng, density, depth + 1, key) for key in chosen}
        more = node.get("additionalProperties")
        if isinstance(more, dict) and rng.random() < 0.5:
            grown[str(rng.choice(("wheels", "floor", "x")))] = self._grown(more, rng, density, depth + 1)
        return grown

    def _array(self, node: Node, rng: Rng, density: float, depth: int) -> list[Any]:
        if "prefixItems" in node:
            return [self._grown(item, rng, density, depth + 1) for item in node["prefixItems"]]
        n = int(rng.integers(node.get("minItems", 0), min(node.get("maxItems", 4), 6) + 1))
        return [self._grown(node.get("items"), rng, density, depth + 1) for _ in range(n)]


def _number(node: Node, rng: Rng) -> float:
    """Return a number that is allowed: near the default, at a bound, or anywhere."""
    low = node.get("minimum", node.get("exclusiveMinimum"))
    high = node.get("maximum", node.get("exclusiveMaximum"))
    default = node.get("default")
    if isinstance(default, int | float) and rng.random() < 0.5:
        return float(default) * float(rng.choice([1.0, 0.5, 2.0]))
    if rng.random() < 0.15:
        return float(rng.choice([1e-12, 1e-3, 1e3, 1e6, 1e9]))
    low = 0.0 if low is None else float(low)
    high = low + float(rng.choice([1.0, 10.0, 100.0])) if high is None else float(high)
    return round(float(rng.uniform(low, high)), 4) or 1e-3


def spoil_document(document: Any, rng: Rng, times: int) -> Any:
    """Make a document wrong in a few places: another type, a key too many, one too few, one misspelt."""
    for _ in range(times):
        places = [place for place in _places(document) if place[0]]
        if not places:
            return document
        holder, key = places[int(rng.integers(len(places)))]
        match int(rng.integers(8)):
            case 0 | 1 | 2:
                holder[key] = deepcopy(_WRONG[int(rng.integers(len(_WRONG)))])  # lists among them are spoilt further
            case 3 if isinstance(holder, dict):
                del holder[key]
            case 4 if isinstance(holder, dict):
                holder[str(rng.choice(_KEYS))] = holder[key]
            case 5:
                holder[key] = [holder[key]]
            case 6:
                holder[key] = {str(rng.choice(_KEYS)): holder[key]}
            case _:
                other, other_key = places[int(rng.integers(len(places)))]
                holder[key] = json.loads(json.dumps(other[other_key], default=str))
    return document


def _places(node: Any) -> Iterator[tuple[Any, Any]]:
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in list(items):
        yield node, key
        yield from _places(value)


def as_yaml(document: Any, rng: Rng) -> str:
    """Return a document as flow YAML, now and then with what only YAML can do wrong."""
    text = _flow(document)
    if rng.random() < 0.85:
        return text
    tricks = (
        lambda: f"%YAML 1.1\n---\n{text}",
        lambda: f"{text}\n---\n{text}",
        lambda: text.replace("{", "&x {", 1).replace(": {", ": *x #", 1),
        lambda: text.replace("{", "{<<: *x, ", 1),
        lambda: text.replace(": ", ": !!binary ", 1),
        lambda: text.replace(": ", ": !<tag:x> ", 1),
        lambda: text.replace("}", "", 1),
        lambda: text.replace(": ", ":\t", 1),
        lambda: text.replace(", ", ",\n\t", 1),
        lambda: text[: int(rng.integers(len(text) + 1))],
        lambda: "\ufeff" + text,
        lambda: text.replace("{", "{? [a, b] : 1, ", 1),
        lambda: text.replace("{", "{a: 1, a: 2, ", 1),
        lambda: text.replace("{", "{" + "[" * 400 + "]" * 400 + ": 1, ", 1),
        lambda: text.replace(": ", ": |\n  ", 1),
    )
    return tricks[int(rng.integers(len(tricks)))]()


def _flow(node: Any) -> str:
    if isinstance(node, dict):
        return "{" + ", ".join(f"{_scalar(key)}: {_flow(value)}" for key, value in node.items()) + "}"
    if isinstance(node, list):
        return "[" + ", ".join(_flow(value) for value in node) + "]"
    return _scalar(node)


def _scalar(value: Any) -> str:
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    if isinstance(value, str) and value.isidentifier():
        return value
    return json.dumps(value)


def as_toml(document: Any) -> str:
    """Return a document as TOML, as far as TOML can say it."""
    if not isinstance(document, dict):
        return json.dumps(document)
    return "\n".join(f"{json.dumps(str(key))} = {_inline(value)}" for key, value in document.items())


def _inline(node: Any) -> str:
    if isinstance(node, dict):
        return "{" + ", ".join(f"{json.dumps(str(key))} = {_inline(value)}" for key, value in node.items()) + "}"
    if isinstance(node, list):
        return "[" + ", ".join(_inline(value) for value in node) + "]"
    if node is None:
        return '""'
    return str(node).lower() if isinstance(node, float) and not math.isfinite(node) else json.dumps(node)
