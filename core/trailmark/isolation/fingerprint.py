"""What a result depends on, in a few hex digits: recordings, code, everything that is not in the config itself."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import trailmark
from trailmark.plugins import Spec

__all__ = ["FileCache", "code_of", "digest_of", "files_in_document", "fingerprint", "source_digest", "without_paths"]

#: Packages of core that no result depends on.
_BESIDE = ("bench", "cli", "isolation", "report", "testing", "starters")

#: ``(path, size, mtime_ns) -> digest``, to be kept between runs: recordings are large.
FileCache = dict[tuple[str, int, int], str]

_CHUNK = 1 << 20


def digest_of(document: Any) -> str:
    """Return the digest of plain data, 64 hex digits; the order of keys has no say."""
    text = json.dumps(document, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def fingerprint(path: str | Path, cache: FileCache | None = None) -> str:
    """Return the digest of a file's content, or of all files of a folder with their names.

    Parameters
    ----------
    path : path
        It must exist.
    cache : dict, optional
        Digests of files that have the same size and time since; new ones are added.
    """
    cache = {} if cache is None else cache
    path = Path(path)
    if path.is_file():
        return _file(path, cache)
    files = sorted(Path(folder) / name for folder, _, names in os.walk(path) for name in names)
    return digest_of([[file.relative_to(path).as_posix(), _file(file, cache)] for file in files if file.is_file()])


def _file(path: Path, cache: FileCache) -> str:
    status = path.stat()
    key = (str(path), status.st_size, status.st_mtime_ns)
    if key not in cache:
        digest = hashlib.sha256()
        with path.open("rb") as file:
            while chunk := file.read(_CHUNK):
                digest.update(chunk)
        cache[key] = digest.hexdigest()
    return cache[key]


def files_in_document(document: Any) -> list[str]:
    """Return the absolute paths in a resolved config that exist, sorted: its recordings and calibrations."""
    return sorted(_paths(document))


def _paths(value: Any) -> set[str]:
    if isinstance(value, Mapping):
        return set().union(*(_paths(item) for item in value.values())) if value else set()
    if isinstance(value, list | tuple):
        return set().union(*(_paths(item) for item in value)) if value else set()
    return {value} if _is_path(value) else set()


def _is_path(value: Any) -> bool:
    return isinstance(value, str) and value.startswith("/") and value != "/" and os.path.exists(value)


def without_paths(value: Any, digest: Callable[[str], str]) -> Any:
    """Return a config with the content of each file in place of its path: the same data elsewhere is the same."""
    if isinstance(value, Mapping):
        return {str(key): without_paths(item, digest) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_paths(item, digest) for item in value]
    return f"content {digest(value)}" if _is_path(value) else value


def code_of(specs: Iterable[Spec], source: bool = True) -> dict[str, str]:
    """Return versions and digests of the code behind some parts, core included, by package.

    Of an installed distribution the version would do (`source` False); of a checkout that is worked on it would not.
    """
    versions = {spec.target.partition(":")[0].partition(".")[0]: spec.version for spec in specs}
    versions["trailmark"] = trailmark.__version__
    return {
        package: f"{version} {source_digest(package)}".lstrip() if source else version
        for package, version in sorted(versions.items())
    }


@lru_cache(maxsize=256)
def source_digest(package: str) -> str:
    found = importlib.util.find_spec(package)
    if found is None or found.origin is None or not Path(found.origin).is_file():  # built in
        return "unknown"
    origin = Path(found.origin)
    files = [origin]
    if origin.name == "__init__.py":
        skipped = _BESIDE if package == "trailmark" else ()
        files = [file for file in origin.parent.rglob("*") if _counts(file, origin.parent, skipped)]
    root = origin.parent
    listed = [[f.relative_to(root).as_posix(), hashlib.sha256(f.read_bytes()).hexdigest()] for f in sorted(files)]
    return digest_of(listed)[:16]


def _counts(file: Path, root: Path, skipped: Iterable[str]) -> bool:
    inside = file.relative_to(root).parts
    is_data = file.suffix in (".py", ".npz", ".npy", ".json")
    return is_data and inside[0] not in skipped and "__pycache__" not in inside and file.is_file()
