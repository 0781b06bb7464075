"""A config as it was written: its data, where in the file every key stands, and which keys hold parts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from trailmark.errors import ConfigError
from trailmark.plugins.hints import did_you_mean

if TYPE_CHECKING:
    from trailmark.plugins.spec import Kind

__all__ = [
    "NAMED_SECTIONS",
    "SINGLE_SECTIONS",
    "Document",
    "Key",
    "Keys",
    "Problems",
    "TextError",
    "expand_shorthand",
    "kind_at",
    "read_document",
]

Key = str | int
Keys = tuple[Key, ...]

#: Sections that hold parts by name.
NAMED_SECTIONS: dict[str, Kind] = {"sources": "source", "localizers": "localizer"}

#: Sections that are one part.
SINGLE_SECTIONS: tuple[Kind, ...] = ("estimator", "path_store", "controller")

# A YAML reader in Python takes seconds for a megabyte; the largest config that was seen has 20 kB.
_MAX_BYTES = 1_000_000


class TextError(Exception):
    """A text that cannot be read: what is wrong, on which line and in which column (from 1).

    Parameters
    ----------
    message : str
        What is wrong.
    line, column : int or None
        Where, from 1; None: nowhere in particular.
    """

    def __init__(self, message: str, line: int | None = None, column: int | None = None) -> None:
        super().__init__(message)
        self.line, self.column = line, column

    def place(self, name: str) -> str:
        """Return ``name line 3, column 5``, as far as it is known."""
        line = "" if self.line is None else f" line {self.line}"
        return name + line + ("" if self.column is None else f", column {self.column}")


def _nowhere(_: Keys) -> None:
    return None


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """Data and the places of its keys.

    Attributes
    ----------
    data : dict
        Mappings, lists and plain values.
    name : str
        What messages call it: the file as it was given.
    base_dir : Path
        Where relative paths in it start; absolute.
    line_of : callable
        From keys to the line where the innermost of them stands, None where no file is behind it.
    overridden : tuple of keys
        What did not come from the file but from ``--set``.
    """

    data: dict[str, Any]
    name: str = "config"
    base_dir: Path = field(default_factory=Path.cwd)
    line_of: Callable[[Keys], int | None] = _nowhere
    overridden: tuple[Keys, ...] = ()

    def line(self, keys: Keys) -> int | None:
        """Return the line of a key; None where it did not come from a file."""
        return None if self.is_overridden(keys) else self.line_of(keys)

    def is_overridden(self, keys: Keys) -> bool:
        """Whether a key was given by ``--set``."""
        return any(keys[: len(path)] == path for path in self.overridden)

    def place(self, keys: Keys) -> str:
        """Return where a key stands: ``config.yaml line 7: localizers.floor.search_px``."""
        line = self.line(keys)
        source = "--set" if self.is_overridden(keys) else self.name if line is None else f"{self.name} line {line}"
        return f"{source}: {'.'.join(str(key) for key in keys)}" if keys else source

    def expanded(self) -> Self:
        """Return a copy that gives ``{plugin: NAME}`` wherever a part is given by its plugin's name alone."""
        data = deepcopy(self.data)
        expand_shorthand(data)
        return replace(self, data=data)


class Problems:
    """Everything that is wrong with a document; raised together, in the order of its lines.

    Parameters
    ----------
    document : Document
        The config; gives lines and keys their places.
    """

    def __init__(self, document: Document) -> None:
        self._document = document
        self._found: list[tuple[int, str]] = []

    def __bool__(self) -> bool:
        return bool(self._found)

    def add(self, keys: Keys, message: str) -> None:
        """Note what is wrong with a key."""
        order = self._document.line(keys) or 0
        text = f"{self._document.place(keys)}: {message}"
        if (order, text) not in self._found:
            self._found.append((order, text))

    def raise_if_any(self, error_class: type[ConfigError] = ConfigError) -> None:
        """Raise one `ConfigError`, or one of its kinds, with a line for each problem.

        Raises
        ------
        ConfigError
            If there is a problem.
        """
        if self._found:
            raise error_class("\n".join(text for _, text in sorted(self._found, key=lambda problem: problem[0])))


def read_document(
    config: str | Path | Mapping[str, Any] | Document, base_dir: Path | None = None, *, what: str = "config"
) -> Document:
    """Read a config from a file (``.toml``, or else YAML) or take a mapping as one.

    Parameters
    ----------
    config : str, Path, mapping or Document
        The file, or what it would hold.
    base_dir : Path, optional
        What its paths are relative to; the file's folder unless given.
    what : str
        What messages call such a file.

    Raises
    ------
    ConfigError
        If the file is missing or unreadable, is no YAML or TOML, or holds no mapping.
    """
    if isinstance(config, Document):
        return config
    if isinstance(config, Mapping):
        return Document(deepcopy(dict(config)), base_dir=(base_dir or Path.cwd()).absolute())
    path = Path(config).expanduser()
    read = _reader(path)
    try:
        data, line_of = read(_text(path, what))
    except TextError as error:
        raise ConfigError(f"{error.place(str(config))}: {error}") from error
    if data is None:
        raise ConfigError(f"{config}: the file is empty")
    if not isinstance(data, dict):
        raise ConfigError(f"{config}: a {what} is a mapping (key: value), not a {type(data).__name__}")
    return Document(data, str(config), (base_dir or path.parent).absolute(), line_of)


def _reader(path: Path) -> Callable[[str], tuple[Any, Callable[[Keys], int | None]]]:
    if path.suffix == ".toml":
        from trailmark.config.toml_text import read_toml

        return read_toml
    from trailmark.config.yaml_text import read_yaml  # ruamel.yaml is loaded when a file is read, not before

    return read_yaml


def _text(path: Path, what: str) -> str:
    if path.exists() and not (path.is_file() or path.is_dir()):  # /dev/zero is read for ever, a pipe waited for
        raise ConfigError(f"{path} is a device or a pipe, not a {what} file; write its text into a file")
    try:
        if path.stat().st_size > _MAX_BYTES:
            megabytes = path.stat().st_size / 1e6
            raise ConfigError(f"{path} has {megabytes:.1f} MB: no {what} is larger than {_MAX_BYTES / 1e6:g} MB")
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        siblings = [entry.name for entry in path.parent.iterdir()] if path.parent.is_dir() else []
        raise ConfigError(f"no {what} file {str(path)!r}{did_you_mean(path.name, siblings)}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not UTF-8 text (byte {error.start})") from error
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error


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
