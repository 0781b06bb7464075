"""TOML with line numbers, as far as they can be had: the reader of the standard library keeps none."""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from collections.abc import Callable
from typing import Any

from trailmark.config.document import Key, TextError

__all__ = ["read_toml"]

_KEY = r"""(?:[A-Za-z0-9_-]+|"[^"]*"|'[^']*')"""
_KEYS = rf"{_KEY}(?:\s*\.\s*{_KEY})*"
_ITEM_TABLE = re.compile(rf"\s*\[\[\s*({_KEYS})\s*\]\]")
_TABLE = re.compile(rf"\s*\[\s*({_KEYS})\s*\]")
_PAIR = re.compile(rf"\s*({_KEYS})\s*=")
_PLACE = re.compile(r"\s*\(at line (\d+), column (\d+)\)")


def read_toml(text: str) -> tuple[Any, Callable[[tuple[Key, ...]], int | None]]:
    """Return the data and a function from keys to the line where they, or what holds them, stand.

    Raises
    ------
    TextError
        If it is no TOML.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        place = _PLACE.search(str(error))
        line, column = (int(place[1]), int(place[2])) if place else (None, None)
        raise TextError(f"TOML syntax: {_PLACE.sub('', str(error))}", line, column) from error
    except ValueError as error:  # an integer of more digits than Python takes from a text
        raise TextError("TOML: an integer with thousands of digits is no number of a config") from error
    except RecursionError as error:
        raise TextError("TOML: nested too deeply") from error
    lines = _lines(text)

    def line_of(keys: tuple[Key, ...]) -> int | None:
        shortened = (keys[:length] for length in range(len(keys), 0, -1))
        return next((lines[part] for part in shortened if part in lines), None)

    return data, line_of


def _lines(text: str) -> dict[tuple[Key, ...], int]:
    """Find tables and keys at the beginnings of lines; keys of inline tables stand where their table stands."""
    lines: dict[tuple[Key, ...], int] = {}
    items: Counter[tuple[Key, ...]] = Counter()
    prefix: tuple[Key, ...] = ()
    for number, line in enumerate(text.splitlines(), start=1):
        if match := _ITEM_TABLE.match(line):
            table = _split(match[1])
            prefix = (*table, items[table])
            items[table] += 1
            lines.setdefault(prefix, number)
        elif match := _TABLE.match(line):
            prefix = _split(match[1])
            lines.setdefault(prefix, number)
        elif match := _PAIR.match(line):
            lines.setdefault((*prefix, *_split(match[1])), number)
    return lines


def _split(keys: str) -> tuple[Key, ...]:
    return tuple(key.strip("\"'") for key in re.findall(_KEY, keys))
