"""Plain data as JSON, arrays and frozen values included, so that reading it runs no code.

A class comes back by its name, and only if it is a dataclass, a named tuple or an enumeration of Trailmark or of one
other package; its fields are set, and nothing of it is called.
"""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from importlib import import_module
from pathlib import Path, PurePath
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["from_plain_bytes", "to_plain_bytes"]


def to_plain_bytes(value: Any, array: Callable[[npt.NDArray[Any]], Any] | None = None) -> bytes:
    """Return a value as JSON.

    Parameters
    ----------
    value : object
        None, truth values, numbers, text, bytes, paths, arrays and scalars of numpy without objects in them; lists,
        tuples, sets and mappings of such; dataclasses, named tuples and enumerations.
    array : callable, optional
        Puts an array elsewhere, and returns in JSON where it is; default: arrays are in the JSON.

    Raises
    ------
    TypeError
        If it is, or holds, anything else.
    """
    try:
        return json.dumps(_Writer(array or _npy).value(value), separators=(",", ":")).encode()
    except RecursionError:
        raise TypeError("it is nested too deeply, or holds itself") from None


def from_plain_bytes(content: bytes, package: str, array: Callable[[Any], npt.NDArray[Any]] | None = None) -> Any:
    """Return the value of `to_plain_bytes`; its classes are of Trailmark or of `package`.

    `array` gives the array that is elsewhere.

    Raises
    ------
    ValueError
        If it is no such JSON, or names a class that has no place in it.
    """
    try:
        return _PlainDecoder(package, array or _array).value(json.loads(content))
    except (KeyError, TypeError, AttributeError, ImportError, OverflowError, MemoryError, RecursionError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from error


class _Writer:
    """Says values as JSON has them."""

    def __init__(self, array: Callable[[npt.NDArray[Any]], Any]) -> None:
        self._array = array

    def value(self, value: Any) -> Any:
        """Return a value as JSON has it; what JSON has not is ``{"tag": ...}``."""
        if isinstance(value, Enum):
            return {"enum": [_name_of(type(value)), value.name]}
        if value is None or type(value) in (bool, int, float, str):
            return value
        if isinstance(value, np.ndarray):
            return {"array": self._array(value)}
        if isinstance(value, np.generic):
            return {"scalar": _npy(np.asarray(value))}
        if is_dataclass(value) and not isinstance(value, type):
            content = {field.name: self.value(getattr(value, field.name)) for field in fields(value)}
            return {"fields": [_name_of(type(value)), content]}
        if isinstance(value, tuple) and hasattr(value, "_fields"):
            return {"named": [_name_of(type(value)), [self.value(item) for item in value]]}
        return self._builtin(value)

    def _builtin(self, value: Any) -> Any:
        match value:
            case list():
                return [self.value(item) for item in value]
            case tuple():
                return {"tuple": [self.value(item) for item in value]}
            case set() | frozenset():
                return {type(value).__name__: [self.value(item) for item in value]}
            case MappingProxyType():
                return {"view": self._pairs(value)}
            case dict():
                return {"dict": self._pairs(value)}
            case bytes():
                return {"bytes": base64.b64encode(value).decode()}
            case complex():
                return {"complex": [value.real, value.imag]}
            case PurePath():
                return {"path": str(value)}
        raise TypeError(f"a {type(value).__module__}.{type(value).__qualname__} is not plain data")

    def _pairs(self, value: Mapping[Any, Any]) -> list[list[Any]]:
        return [[self.value(key), self.value(item)] for key, item in value.items()]


def _name_of(cls: type) -> str:
    if "<locals>" in cls.__qualname__:
        raise TypeError(f"{cls.__qualname__} is not at the top of a module: nobody could find it again")
    return f"{cls.__module__}:{cls.__qualname__}"


def _npy(array: npt.NDArray[Any]) -> str:
    stream = io.BytesIO()
    try:
        np.lib.format.write_array(stream, array, allow_pickle=False)
    except ValueError as error:
        raise TypeError(f"an array of {array.dtype} is not plain data: {error}") from error
    return base64.b64encode(stream.getvalue()).decode()


def _array(text: str) -> npt.NDArray[Any]:
    array: npt.NDArray[Any] = np.lib.format.read_array(io.BytesIO(base64.b64decode(text)), allow_pickle=False)
    return array


def _field_names(cls: type[Any]) -> set[str] | None:
    """Return the names of a dataclass's fields; None of any other class."""
    return {field.name for field in fields(cls)} if is_dataclass(cls) else None


class _PlainDecoder:
    """Puts values together again, with the classes of a few packages."""

    def __init__(self, package: str, array: Callable[[Any], npt.NDArray[Any]]) -> None:
        self._package = package
        self._of_tag: dict[str, Callable[[Any], Any]] = {
            "enum": lambda told: self._class(told[0], Enum)[told[1]],
            "array": array,
            "scalar": lambda text: _array(text)[()],
            "fields": self._dataclass,
            "named": lambda told: tuple.__new__(self._class(told[0], tuple), self._items(told[1])),
            "tuple": lambda items: tuple(self._items(items)),
            "set": lambda items: set(self._items(items)),
            "frozenset": lambda items: frozenset(self._items(items)),
            "view": lambda pairs: MappingProxyType(self._mapping(pairs)),
            "dict": self._mapping,
            "bytes": base64.b64decode,
            "complex": lambda parts: complex(*parts),
            "path": Path,
        }

    def value(self, told: Any) -> Any:
        if isinstance(told, list):
            return list(self._items(told))
        if not isinstance(told, dict):
            return told
        ((tag, content),) = told.items()
        return self._of_tag[tag](content)

    def _items(self, told: Iterable[Any]) -> Iterable[Any]:
        return [self.value(item) for item in told]

    def _mapping(self, pairs: Iterable[tuple[Any, Any]]) -> dict[Any, Any]:
        return {self.value(key): self.value(item) for key, item in pairs}

    def _dataclass(self, told: tuple[str, Mapping[str, Any]]) -> Any:
        name, content = told
        cls = self._class(name, object)
        if _field_names(cls) != set(content):
            raise ValueError(f"{name} is no dataclass with the fields {', '.join(content)}")
        made: Any = object.__new__(cls)
        for field, item in content.items():
            object.__setattr__(made, field, self.value(item))  # as for a copy: nothing of the class is called
        return made

    def _class(self, name: str, base: type) -> type[Any]:
        """Return a class by its name; only modules of Trailmark and of the package are imported."""
        module, _, path = name.partition(":")
        top = module.partition(".")[0]
        if not (top in ("trailmark", self._package) or top.startswith("trailmark_")):
            raise ValueError(f"{name} has no place in an answer")
        found: Any = import_module(module)
        for part in path.split("."):
            found = getattr(found, part)
        if not (isinstance(found, type) and issubclass(found, base) and found.__module__ == module):
            raise ValueError(f"{name} has no place in an answer")
        return found
