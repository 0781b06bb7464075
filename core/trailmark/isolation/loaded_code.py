"""What code an answer rests on: the modules that its process had loaded when it was found, by their digests."""

from __future__ import annotations

import hashlib
import importlib.util
import sys
import time
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path

from trailmark.isolation.fingerprint import BESIDE, DATA_SUFFIXES

__all__ = ["LoadedCode", "is_as_loaded", "loaded_code"]

#: Digests by package and file in it.
LoadedCode = Mapping[str, Mapping[str, str]]

#: Modules of a plugin that are loaded whether it is used or not.
_DOORS = ("__init__.py", "plugin.py")
#: What is written later is not what this process has loaded.
_BEGAN_S = time.time()


def loaded_code(own: str, others: Iterable[str]) -> LoadedCode | None:
    """Return the digests of what this process has loaded of some packages.

    Beside modules it is all data of these packages. It is more than what one call needed where calls share a process.
    Another plugin of which only the doors were loaded has no say, nor has what no result depends on.

    Parameters
    ----------
    own : str
        The package of the function that was called.
    others : iterable of str
        Whatever it may have used, such as ``"trailmark_divs"``.

    Returns
    -------
    mapping or None
        None where nobody can know: the function's package has no files, or a file has changed since it was loaded.
    """
    used: dict[str, dict[str, str]] = {}
    for package in sorted({own, *others}):
        root = _root_of(package)
        if root is None:
            if package == own and package not in sys.builtin_module_names:
                return None
            continue
        modules = [name for name in _loaded_files(package, root) if not _is_beside(package, name)]
        if package == own or any(name not in _DOORS for name in modules):
            names = sorted({*modules, *_data_in(root)})
            if any(_written_s(root / name) > _BEGAN_S for name in names):
                return None
            used[package] = {name: _digest_of(root / name) for name in names}
    return used


def is_as_loaded(code: LoadedCode) -> bool:
    """Return whether what `loaded_code` told is the same today."""
    for package, files in code.items():
        root = _root_of(package)
        if root is None or any(_digest_of(root / name) != digest for name, digest in files.items()):
            return False
        if not set(_data_in(root)) <= files.keys():  # a new file
            return False
    return True


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


def _written_s(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return -1.0


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
