"""Calibrations as configs give them: a file, or the numbers themselves."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import trailmark.frames
from trailmark.config.document import read_document
from trailmark.config.files import resolve_path
from trailmark.errors import ConfigError

__all__ = ["read_calibration", "with_absolute_files"]


_ARRAY_FILES = (".npy", ".png")


def read_calibration(
    value: str | Path | Mapping[str, Any], base_dir: Path | None = None
) -> trailmark.frames.Calibration:
    """Return the calibration of a YAML, TOML or JSON file, or of a mapping.

    Parameters
    ----------
    value : path or mapping
        File names in a mapping start at `base_dir`; those in a file start at the file's folder.
    base_dir : Path, optional
        Default: the working folder.

    Raises
    ------
    ConfigError
        If the file cannot be read, or it is no calibration.
    """
    from trailmark.frames.documents import calibration_from_document

    if isinstance(value, Mapping):
        return calibration_from_document(value, base_dir or Path.cwd())
    document = read_document(resolve_path(value, base_dir))
    try:
        return calibration_from_document(document.data, document.base_dir)
    except ConfigError as error:
        raise ConfigError(f"{value}: {error}") from error


def with_absolute_files(value: Any, base_dir: Path) -> Any:
    """Return a calibration with the files that it names made absolute, so that it may be copied elsewhere."""
    if isinstance(value, Mapping):
        return {key: with_absolute_files(item, base_dir) for key, item in value.items()}
    if isinstance(value, str) and value.endswith(_ARRAY_FILES):
        return str(resolve_path(value, base_dir))
    return value
