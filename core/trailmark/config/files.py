"""Paths in configs: relative ones start at the config's folder, not where the program was started.

``~`` and ``${VARIABLE}`` are expanded, so that a config can point to recordings that live elsewhere on each machine.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, ValidationInfo

from trailmark.plugins.hints import did_you_mean

__all__ = ["BASE_DIR", "ConfigPath", "ExistingFile", "ExistingPath", "IsWritten", "OutputPath", "resolve_path"]

#: Key of the validation context under which the host gives the config's folder.
BASE_DIR = "base_dir"

_VARIABLE = re.compile(r"\$\{([A-Za-z_][A-Za-z0-9_]*)\}")


def resolve_path(value: str | Path, base_dir: Path | None = None) -> Path:
    """Return a path with ``~`` and ``${VARIABLE}`` expanded; a relative one starts at `base_dir`, or where we work.

    Raises
    ------
    ValueError
        If a variable is not set.
    """
    path = Path(os.path.expanduser(_VARIABLE.sub(_value_of, str(value))))
    return path if path.is_absolute() else (base_dir or Path.cwd()) / path


def _value_of(match: re.Match[str]) -> str:
    value = os.environ.get(match[1])
    if not value:
        raise ValueError(f"the environment variable {match[1]} is not set; it is part of the path {match.string}")
    return value


def _base_dir(info: ValidationInfo) -> Path | None:
    context: dict[str, Any] = info.context or {}
    return context.get(BASE_DIR)


def _resolve(value: Path, info: ValidationInfo) -> Path:
    return resolve_path(value, _base_dir(info))


def _resolve_existing(value: Path, info: ValidationInfo) -> Path:
    path = _resolve(value, info)
    if not os.path.exists(path):  # unlike Path.exists() never raises: too long, no permission, no such host
        raise ValueError(f"no such file or folder: {path}{_nearby(path)}")
    if not (os.path.isfile(path) or os.path.isdir(path)):  # /dev/zero would be read for ever
        raise ValueError(f"is neither a file nor a folder: {path}")
    return path


def _resolve_file(value: str, info: ValidationInfo) -> str:
    path = _resolve_existing(Path(value), info)
    if not os.path.isfile(path):
        raise ValueError(f"is a folder, not a file: {path}")
    return str(path)


def _nearby(path: Path) -> str:
    """Name what the folder holds instead, or the part of the path where it goes wrong."""
    folder = path.parent
    if os.path.isdir(folder):
        return did_you_mean(path.name, os.listdir(folder) if os.access(folder, os.R_OK) else ())
    while not os.path.isdir(folder):
        folder = folder.parent
    return f" ({folder} is the last folder of it that exists)"


ConfigPath = Annotated[Path, AfterValidator(_resolve)]
"""A path that need not exist yet; relative ones start at the config's folder."""


@dataclass(frozen=True, slots=True)
class IsWritten:
    """Marks a path that is written to."""


OutputPath = Annotated[Path, AfterValidator(_resolve), IsWritten()]
"""A file or folder that is written; in a config file it must lie within the config's folder."""

ExistingPath = Annotated[Path, AfterValidator(_resolve_existing)]
"""A file or folder that must exist; relative ones start at the config's folder. Missing: an error with line."""

ExistingFile = Annotated[str, AfterValidator(_resolve_file)]
"""As `ExistingPath`, but a file, and kept as text."""
