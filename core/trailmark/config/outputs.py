"""Files that a config lets its parts write: they stay within the config's folder.

A config may come from a stranger. What is given on the command line (``--set``) or by a program may lie anywhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, get_args

from trailmark.config.base import PluginConfig
from trailmark.config.document import Document, Problems
from trailmark.config.entries import PartEntry
from trailmark.config.files import IsWritten

__all__ = ["refuse_outputs_elsewhere"]


def refuse_outputs_elsewhere(parts: Iterable[PartEntry[Any]], document: Document, problems: Problems) -> None:
    """Note every `OutputPath` of a config file that leads out of the file's folder, by links too."""
    home = document.base_dir.resolve()
    for part in parts:
        for name, path in _outputs(part.config):
            keys = (*part.keys, name)
            is_in_file = document.line(keys) is not None
            if is_in_file and not path.resolve().is_relative_to(home):
                problems.add(
                    keys, f"{path} lies outside of the config's folder; to write there, say --set {_dotted(keys)}=..."
                )


def _outputs(config: PluginConfig) -> Iterator[tuple[str, Path]]:
    for name, field in type(config).model_fields.items():
        value = getattr(config, name)
        if isinstance(value, Path) and any(_is_output(part) for part in (*field.metadata, field.annotation)):
            yield name, value


def _is_output(annotation: Any) -> bool:
    """Return whether a type, or one of those that it is made of, is an `OutputPath`."""
    if isinstance(annotation, IsWritten):
        return True
    return any(_is_output(part) for part in (*get_args(annotation), *getattr(annotation, "__metadata__", ())))


def _dotted(keys: Iterable[object]) -> str:
    return ".".join(map(str, keys))
