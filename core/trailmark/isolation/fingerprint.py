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
BESIDE = ("bench", "cli", "isolation", "report", "testing", "starters")
_SMOOTHER, _KALMAN = "trailmark.estimation.smoother", "trailmark.estimation.kalman"
#: Packages of core that results depend on only if a part stands in one of these: nothing else imports them.
_OF_THEIR_PARTS = {_SMOOTHER: (_SMOOTHER,), _KALMAN: (_KALMAN, _SMOOTHER)}
#: What decides a result, beside modules: learned weights, tables.
DATA_SUFFIXES = (".npz", ".npy", ".json")

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
    versions = {"trailmark": trailmark.__version__}
    for spec in specs:
        module = spec.target.partition(":")[0]
        versions[module.partition(".")[0]] = spec.version
        needed = [room for room, users in _OF_THEIR_PARTS.items() if module.rpartition(".")[0] in users]
        versions |= dict.fromkeys(needed, spec.version)
    return {
        package: f"{version} {source_digest(package)}".lstrip() if source else version
        for package, version in sorted(versions.items())
    }


@lru_cache(maxsize=256)
def source_digest(package: str) -> str:
    """Return the digest of a package's sources and data, 16 hex digits; "unknown" for what is built in.

    Rooms of core count that every result depends on; the others have digests of their own.
    """
    found = importlib.util.find_spec(package)
    if found is None or found.origin is None or not Path(found.origin).is_file():  # built in
        return "unknown"
    origin = Path(found.origin)
    root = origin.parent
    names = [origin.name] if origin.name != "__init__.py" else _sources_in(root)
    apart = tuple(f"{room.replace('.', '/')}/" for room in _rooms_apart_in(package))
    kept = sorted(name for name in names if not name.startswith(apart))
    return digest_of([[name, hashlib.sha256((root / name).read_bytes()).hexdigest()] for name in kept])[:16]


def _sources_in(root: Path) -> list[str]:
    """Return the paths of a package's sources and data below its folder."""
    files = [path for path in root.rglob("*") if path.suffix in (".py", *DATA_SUFFIXES) and path.is_file()]
    return [path.relative_to(root).as_posix() for path in files if "__pycache__" not in path.parts]


def _rooms_apart_in(package: str) -> list[str]:
    """Return the packages in a package that do not count with it."""
    apart = [*(f"trailmark.{name}" for name in BESIDE), *_OF_THEIR_PARTS]
    return [room.removeprefix(f"{package}.") for room in apart if room.startswith(f"{package}.")]
