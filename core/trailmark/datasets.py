"""Recordings on disk by name: what they hold, whose they are, how they are read, and what their truth is."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = ["FOLDER_MARK", "Dataset", "digest_of"]

#: In the texts of a config: the folder below which the recordings lie.
FOLDER_MARK = "{data}"

_BLOCK_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class Dataset:
    """A recording. Nothing is ever fetched: it names the place where it can be had, and the user names the folder.

    Attributes
    ----------
    summary : str
        What was recorded, in one line.
    files : mapping of str to str
        Path below the folder of recordings, and the SHA-256 of the file, or of a folder (see `digest_of`); "" where
        it is not known.
    config : mapping
        A run config that plays it; ``{data}`` in its texts stands for the folder of recordings.
    truth : str
        What is known of the true poses; "" where nothing is.
    licence, cite, url : str
        Under what terms, whom to cite, where it can be had.
    """

    summary: str
    files: Mapping[str, str]
    config: Mapping[str, Any]
    truth: str = ""
    licence: str = ""
    cite: str = ""
    url: str = ""

    def missing(self, data: Path) -> tuple[str, ...]:
        """Return which of its files are not below a folder of recordings."""
        return tuple(name for name in self.files if not (data / name).exists())

    def damaged(self, data: Path) -> tuple[str, ...]:
        """Return which of its files are there and are not those that it was tried with."""
        present = ((data / name, digest) for name, digest in self.files.items() if digest and (data / name).exists())
        return tuple(path.relative_to(data).as_posix() for path, digest in present if digest_of(path) != digest)

    def config_in(self, data: Path) -> dict[str, Any]:
        """Return the config that plays it from a folder of recordings."""
        placed: dict[str, Any] = _fill_in_folder(self.config, str(data))
        return placed


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file; of a folder, that of the names and digests of all files below it, sorted."""
    digest = hashlib.sha256()
    if path.is_dir():
        for file in sorted(file for file in path.rglob("*") if file.is_file()):
            digest.update(f"{file.relative_to(path).as_posix()} {digest_of(file)}\n".encode())
        return digest.hexdigest()
    with path.open("rb") as stream:
        while block := stream.read(_BLOCK_BYTES):
            digest.update(block)
    return digest.hexdigest()


def _fill_in_folder(value: Any, folder: str) -> Any:
    if isinstance(value, str):
        return value.replace(FOLDER_MARK, folder)
    if isinstance(value, Mapping):
        return {key: _fill_in_folder(item, folder) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_fill_in_folder(item, folder) for item in value]
    return value
