"""YAML 1.2 with line numbers: ``1e-3`` is a number, ``no`` is a string, nothing but plain data comes out."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.constructor import SafeConstructor
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.reader import ReaderError
from ruamel.yaml.representer import SafeRepresenter

from trailmark.config.document import Key, TextError

__all__ = ["dump_yaml", "parse_value", "read_yaml"]

_VERSION = re.compile(r"%YAML[ \t]+(\S+)")
_OTHER_BREAKS = re.compile("[\x85\u2028\u2029]")
# A date stays text, a merge key (`<<`) is a mapping.
_PLAIN = frozenset({"str", "int", "float", "bool", "null", "map", "seq", "timestamp", "merge"})

_MAX_MERGED_KEYS = 10_000


class _Constructor(SafeConstructor):
    """Dates stay text, as YAML 1.2 has it: a folder may be called 2026-11-20. A wrong value is said with its line."""

    def construct_object(self, node: Node, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (ValueError, LookupError, TypeError) as error:  # `!!int x`, `!!bool 2`, `0o_`
            kind = str(node.tag).rpartition(":")[2]
            mark = node.start_mark
            raise TextError(f"YAML: {str(node.value)[:40]!r} is no {kind}", mark.line + 1, mark.column + 1) from error


_Constructor.add_constructor("tag:yaml.org,2002:timestamp", SafeConstructor.construct_yaml_str)


class _Representer(SafeRepresenter):
    """Line breaks that are no newline are escaped: read again as they are, they would be spaces."""

    def represent_str(self, data: str) -> Any:
        style = '"' if _OTHER_BREAKS.search(data) else None
        return self.represent_scalar("tag:yaml.org,2002:str", data, style=style)


_Representer.add_representer(str, _Representer.represent_str)


def _yaml() -> YAML:
    yaml = YAML(typ="safe", pure=True)
    yaml.Constructor = _Constructor
    yaml.composer.warn_double_anchors = False  # YAML 1.2 allows it: an alias means the last node of that name before it
    return yaml


def read_yaml(text: str) -> tuple[Any, Callable[[tuple[Key, ...]], int | None]]:
    """Return the data and a function from keys to the line where they stand.

    Raises
    ------
    TextError
        If it is no YAML 1.2, a key stands twice in a mapping, an alias lies within its own anchor, or a tag asks for
        more than plain data.
    """
    _refuse_other_versions(text)
    try:
        root = _yaml().compose(text)
        _check(root, set(), set())
        _refuse_merge_bombs(root)
        data = _yaml().load(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        story = ", ".join(part for part in (error.context, error.problem) if part)
        story = re.sub(r' with value ".*?" \(original value: ".*"\)$', "", story, flags=re.DOTALL)  # "{}", of mappings
        raise TextError(f"YAML syntax: {story}", mark.line + 1, mark.column + 1) from error
    except ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise TextError(f"YAML syntax: the character {chr(error.character)!r} is not allowed", line) from error
    except YAMLError as error:
        raise TextError(f"YAML syntax: {error}") from error
    except RecursionError as error:
        raise TextError("YAML: nested too deeply") from error
    return data, lambda keys: _line(root, keys)


def _refuse_other_versions(text: str) -> None:
    """Refuse a text that says it is of another version: to YAML 1.1 ``no`` is false and 1:30 a number."""
    for number, line in enumerate(text.splitlines(), start=1):
        if line.startswith("---") or not (line.startswith(("%", "#")) or not line.strip()):
            return
        found = _VERSION.match(line)
        if found is not None and found[1] != "1.2":
            raise TextError(f"this says it is YAML {found[1]}: configs are YAML 1.2", number)


def parse_value(text: str) -> Any:
    """Return the value of a piece of YAML, as it stands after ``--set key=``."""
    return read_yaml(text)[0]


def dump_yaml(data: Any) -> str:
    """Return plain data as YAML, keys in their order."""
    from io import StringIO

    yaml = YAML(typ="safe", pure=True)
    yaml.Representer = _Representer
    yaml.default_flow_style = False
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.width = 120
    stream = StringIO()
    yaml.dump(data, stream)
    return stream.getvalue()


def _check(node: Node | None, open_nodes: set[int], done: set[int]) -> None:
    """Refuse keys that stand twice, nodes that contain themselves, and what is no plain data."""
    if node is None or id(node) in done:
        return
    family, _, kind = str(node.tag).rpartition(":")
    if family == "tag:yaml.org,2002" and kind not in _PLAIN:
        raise TextError(f"YAML: a config holds plain data, no !!{kind}", node.start_mark.line + 1)
    if isinstance(node, ScalarNode):
        return
    if id(node) in open_nodes:
        raise TextError("an alias stands within its own anchor", node.start_mark.line + 1)
    open_nodes.add(id(node))
    if isinstance(node, MappingNode):
        _refuse_duplicates(node)
    for child in _children(node):
        _check(child, open_nodes, done)
    done.add(id(node))


def _refuse_duplicates(node: MappingNode) -> None:
    first: dict[str, int] = {}
    for key, _ in node.value:
        line = key.start_mark.line + 1
        if isinstance(key, ScalarNode) and first.setdefault(key.value, line) != line:
            raise TextError(f"duplicate key {key.value!r}: it stands on line {first[key.value]} already", line)


def _refuse_merge_bombs(root: Node | None) -> None:
    """Refuse merge keys (``<<``) that would copy more keys than any config has: ten lines can ask for 9^9 of them."""
    sizes: dict[int, int] = {}

    def size_of(node: Node) -> int:
        if id(node) not in sizes:
            merged = [value for key, value in node.value if _is_merge(key)] if isinstance(node, MappingNode) else []
            parts = [part for value in merged for part in (value.value if isinstance(value, SequenceNode) else [value])]
            sizes[id(node)] = len(node.value) + sum(size_of(part) for part in parts)
            if sizes[id(node)] > _MAX_MERGED_KEYS:
                line = node.start_mark.line + 1
                raise TextError(f"YAML: the merge keys (<<) make more than {_MAX_MERGED_KEYS} keys of this", line)
        return sizes[id(node)]

    seen: set[int] = set()
    waiting = [] if root is None else [root]
    while waiting:
        node = waiting.pop()
        if id(node) in seen or isinstance(node, ScalarNode):
            continue
        seen.add(id(node))
        size_of(node)
        waiting.extend(_children(node))


def _is_merge(key: Node) -> bool:
    return isinstance(key, ScalarNode) and str(key.tag) == "tag:yaml.org,2002:merge"


def _children(node: Node) -> list[Node]:
    return [value for _, value in node.value] if isinstance(node, MappingNode) else list(node.value)


def _line(node: Node | None, keys: tuple[Key, ...]) -> int | None:
    """Return the line of the innermost key that stands in the text."""
    line = None
    for wanted in keys:
        found = _step(node, wanted)
        if found is None:
            break
        line, node = found
    return line


def _step(node: Node | None, wanted: Key) -> tuple[int, Node] | None:
    if isinstance(node, MappingNode):
        pairs = (pair for pair in node.value if str(pair[0].value) == str(wanted))
        return next(((key.start_mark.line + 1, value) for key, value in pairs), None)
    if isinstance(node, SequenceNode) and isinstance(wanted, int) and wanted < len(node.value):
        return node.value[wanted].start_mark.line + 1, node.value[wanted]
    return None
