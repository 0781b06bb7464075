"""What code an answer rests on: the modules that its process had loaded when it was found, by their digests."""

from __future__ import annotations

import hashlib
import importlib.util
import sys
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path

from trailmark.isolation.fingerprint import BESIDE, DATA_SUFFIXES

__all__ = ["is_as_loaded", "loaded_code"]

#: Modules of a plugin that are loaded whether it is used or not.
_DOORS = ("__init__.py", "plugin.py")


def loaded_code(packages: Iterable[str]) -> dict[str, dict[str, str]]:
    """Return the digests of what this process has loaded of some packages, by package and file in it.

    Beside modules it is all data of these packages. It is more than what one call needed where calls share a process,
    and never less. A plugin of which only the doors were loaded has no say, nor has what no result depends on.

    Parameters
    ----------
    packages : iterable of str
        Such as ``"trailmark_divs"``.
    """
    used = {}
    for package in packages:
        root = _root_of(package)
        if root is None:
            continue
        modules = [name for name in _loaded_files(package, root) if not _is_beside(package, name)]
        if any(name not in _DOORS for name in modules):
            used[package] = {name: _digest_of(root / name) for name in sorted({*modules, *_data_in(root)})}
    return used


def is_as_loaded(code: Mapping[str, Mapping[str, str]]) -> bool:
    """Return whether what `loaded_code` told is the same today."""
    return all(
        (root := _root_of(package)) is not None
        and all(_digest_of(root / name) == digest for name, digest in files.items())
        for package, files in code.items()
    )


def _root_of(package: str) -> Path | None:
    """Return the folder of a package, or that of a module of one file; None where it has none, as what is built in."""
    try:
        found = importlib.util.find_spec(package)
    except (ImportError, ValueError):
        return None
    return None if found is None or found.origin in (None, "built-in", "frozen") else Path(str(found.origin)).parent


def _loaded_files(package: str, root: Path) -> list[str]:
    """Return the loaded modules of a package, by their paths below its folder."""
    loaded = [module for name, module in sys.modules.copy().items() if f"{name}.".startswith(f"{package}.")]
    files = [Path(file) for module in loaded if (file := getattr(module, "__file__", None))]
    return [file.relative_to(root).as_posix() for file in files if file.is_relative_to(root)]


def _is_beside(package: str, name: str) -> bool:
    return package == "trailmark" and name.partition("/")[0] in BESIDE


def _data_in(root: Path) -> list[str]:
    """Return the data of a package; a module of one file has none."""
    if not (root / "__init__.py").is_file():
        return []
    return [path.relative_to(root).as_posix() for path in root.rglob("*") if path.suffix in DATA_SUFFIXES]


def _digest_of(path: Path) -> str:
    """Return the digest of a file, "" where there is none."""
    try:
        status = path.stat()
        return _digest(str(path), status.st_size, status.st_mtime_ns)
    except OSError:
        return ""


@lru_cache(maxsize=4096)
def _digest(path: str, size: int, mtime_ns: int) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()[:16]
