"""Which code a page of results is made of: the files that its program read, each by a digest of what it means."""

from __future__ import annotations

import ast
import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

__all__ = ["Code", "noted_paths", "packed", "unpacked"]

_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
#: Where code is, and what a page may be read from.
_ROOMS = ("core", "plugins", "examples", "benchmarks", "tests", "docs/results")
#: What programs and installers leave in these rooms; folders that begin with a dot are theirs, too.
_LEFT_BEHIND = ("__pycache__", "site-packages", "node_modules")
_LEFT_SUFFIXES = (".egg-info", ".pyc", ".nbi", ".nbc")
#: Read of every plugin that is installed, whether a program uses it or not.
_DOORS = ("__init__.py", "plugin.py")


class Code:
    """The code of a checkout; what a file means is looked up once.

    Parameters
    ----------
    top : Path
        The checkout.
    """

    def __init__(self, top: Path) -> None:
        self._top = top
        self._digests: dict[str, str] = {}

    def digest(self, name: str) -> str:
        """Return the digest of a file, by its path in the checkout; "" where there is none that can be read."""
        if name not in self._digests:
            try:
                self._digests[name] = hashlib.sha256(_meaning_of(self._top / name)).hexdigest()[:10]
            except OSError:
                self._digests[name] = ""
        return self._digests[name]

    def everything(self) -> dict[str, str]:
        """Return the digests of all files: which of them a program reads is known when it has ended."""
        paths = [path for room in _ROOMS for path in (self._top / room).rglob("*") if path.is_file()]
        return {name: self.digest(name) for name in self.names(paths)}

    def names(self, paths: Iterable[Path]) -> list[str]:
        """Return what of some paths is code, by paths in the checkout, there or not; compiled files are sources."""
        sources = {_source_of(path) for path in paths if path.is_relative_to(self._top)}
        names = {source.relative_to(self._top).as_posix() for source in sources}
        rooms = tuple(f"{room}/" for room in _ROOMS)
        return sorted(name for name in names if name.startswith(rooms) and not _is_left_behind(name))

    def read(self, paths: Iterable[Path], before: Mapping[str, str]) -> list[str]:
        """Return what of the files that a program read is code of its own: not the doors of plugins it did not use.

        What was there `before` and has gone is code; what was looked for and never was there is not.
        """
        names = [name for name in self.names(paths) if name in before or self.digest(name)]
        used = {_folder(name) for name in names if _name(name) not in _DOORS}
        return [name for name in names if _folder(name) in used]


def packed(code: Mapping[str, str], kept: dict[str, str]) -> dict[str, str]:
    """Return files and digests by folder, each as a key of `kept`: many pages read the same files of a folder."""
    lines: dict[str, list[str]] = {}
    for name in sorted(code):
        lines.setdefault(_folder(name), []).append(f"{_name(name)} {code[name]}")
    keys = {}
    for folder, files in lines.items():
        line = ", ".join(files)
        keys[folder] = hashlib.sha256(line.encode()).hexdigest()[:10]
        kept[keys[folder]] = line
    return keys


def unpacked(keys: Mapping[str, str], kept: Mapping[str, str]) -> dict[str, str]:
    """Return files and digests as they were before `packed`."""
    return dict(_files_of(keys, kept))


def _files_of(keys: Mapping[str, str], kept: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    for folder, key in keys.items():
        for file in kept[key].split(", "):
            name, _, digest = file.rpartition(" ")
            yield f"{folder}/{name}", digest


def noted_paths(notes: Path) -> set[Path]:
    """Return what programs read, by the notes of `traced/sitecustomize.py`."""
    lines = (line for note in notes.iterdir() for line in note.read_bytes().split(b"\n") if line)
    return {Path(os.fsdecode(line)) for line in lines}  # a name need not be text


def _folder(name: str) -> str:
    return name.rpartition("/")[0]


def _name(name: str) -> str:
    return name.rpartition("/")[2]


def _is_left_behind(name: str) -> bool:
    """Return whether a file is no code: a cache, or what an installer wrote."""
    parts = name.split("/")
    return any(part in _LEFT_BEHIND or part.startswith(".") or part.endswith(_LEFT_SUFFIXES) for part in parts)


def _source_of(path: Path) -> Path:
    """Return the source of a compiled file; any other file is its own."""
    return path.parent.parent / (path.name.partition(".")[0] + ".py") if path.suffix == ".pyc" else path


def _meaning_of(path: Path) -> bytes:
    """Return a file without what changes no figure: comments, docstrings and layout of Python."""
    if path.suffix != ".py":
        return path.read_bytes()
    try:
        tree = ast.parse(path.read_text(encoding="utf-8"))
    except (SyntaxError, ValueError):  # half written, or no text at all: another file's page need not care
        return path.read_bytes()
    for node in ast.walk(tree):
        if isinstance(node, _DOCUMENTED) and ast.get_docstring(node):
            node.body = node.body[1:] or [ast.Pass()]
    return ast.unparse(tree).encode()
