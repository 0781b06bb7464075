"""Plugins: entry points of installed distributions and single files, which of them may load, what became of each."""

from __future__ import annotations

import importlib.util
import logging
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

from trailmark.errors import ConfigError, PluginLoadError
from trailmark.plugins.spec import Spec

__all__ = [
    "ALLOW_VARIABLE",
    "CORE",
    "ENTRY_POINT_GROUP",
    "STRICT_VARIABLE",
    "Candidate",
    "PluginRecord",
    "Selection",
    "Status",
    "file_candidates",
    "installed_candidates",
]

logger = logging.getLogger(__name__)

#: The entry-point group of Trailmark's plugins.
ENTRY_POINT_GROUP = "trailmark"

#: Names of the plugins that may load, separated by commas; empty: none but core.
ALLOW_VARIABLE = "TRAILMARK_PLUGINS"

#: Set to anything but 0: the first plugin that does not load ends the program.
STRICT_VARIABLE = "TRAILMARK_STRICT_PLUGINS"

#: Entry point of the parts that every run needs; it cannot be blocked.
CORE = ("trailmark", "core")

Status = Literal["ok", "failed", "blocked", "disabled"]


@dataclass(frozen=True, slots=True)
class Candidate:
    """A plugin that has not been imported yet.

    Attributes
    ----------
    name, distribution, version, module : str
        As in `PluginRecord`.
    load : callable
        Imports and returns the plugin object; may raise anything.
    """

    name: str
    distribution: str
    version: str
    module: str
    load: Callable[[], Any]


def installed_candidates(entry_points: Iterable[metadata.EntryPoint] | None = None) -> list[Candidate]:
    """Return the plugins of all installed distributions, in the order of (distribution, name).

    The order in which the installer wrote them has no meaning, so it is not kept.
    """
    points = _entry_points() if entry_points is None else entry_points
    known: dict[int, tuple[str, str]] = {}
    found = []
    for point in points:
        distribution, version = known.setdefault(id(point.dist), _identity(point.dist))
        found.append(Candidate(point.name, distribution, version, point.value, point.load))
    return sorted(found, key=lambda candidate: (candidate.distribution, candidate.name))


def file_candidates(paths: Iterable[Path]) -> list[Candidate]:
    """Return one-file plugins in the order given; each is a module of its own name."""
    return [Candidate(path.stem, path.name, "", _module_name(path), partial(_import_file, path)) for path in paths]


def _entry_points() -> Iterator[metadata.EntryPoint]:
    try:
        yield from metadata.entry_points(group=ENTRY_POINT_GROUP)
        return
    except Exception:  # one distribution with a malformed file: ask each by itself
        logger.debug("entry points cannot be read at once", exc_info=True)
    for distribution in metadata.distributions():
        try:
            yield from distribution.entry_points.select(group=ENTRY_POINT_GROUP)
        except Exception:
            logger.warning("the entry points of %s cannot be read", _identity(distribution)[0])


def _identity(distribution: metadata.Distribution | None) -> tuple[str, str]:
    try:
        return (str(distribution.name), str(distribution.version)) if distribution else ("unknown", "")
    except Exception:  # metadata without a name or a version
        return "unknown", ""


def _module_name(path: Path) -> str:
    return "trailmark_file_" + re.sub(r"\W", "_", path.stem)


def _import_file(path: Path) -> Any:
    name = _module_name(path)
    loaded = sys.modules.get(name)
    if loaded is not None:
        if loaded.__file__ == str(path):
            return loaded  # the same classes, however often plugins are loaded
        raise PluginLoadError(f"{path} and {loaded.__file__} both make the module {name}: rename one of the files")
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise PluginLoadError(f"{path} is no Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # before it runs: dataclasses and pydantic look their module up
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


@dataclass(frozen=True, slots=True)
class PluginRecord:
    """One entry point or one-file plugin, and what became of it.

    Attributes
    ----------
    name, distribution, version : str
        The entry point and the distribution it belongs to; for a one-file plugin its stem and file name.
    module : str
        What was, or would have been, imported.
    status : {"ok", "failed", "blocked", "disabled"}
        Loaded; raised while loading or was refused; blocked by name; not on the allow list.
    error, traceback : str
        One line, and the whole story, of a ``failed`` one.
    needs_other_api : bool
        It failed because it is written for another plugin API.
    hooks : tuple of str
        The hooks it implements.
    specs : tuple of Spec
        The parts it registered.
    import_ms : float
        How long its import took [ms].
    """

    name: str
    distribution: str
    version: str
    module: str
    status: Status
    error: str = ""
    traceback: str = ""
    needs_other_api: bool = False
    hooks: tuple[str, ...] = ()
    specs: tuple[Spec, ...] = ()
    import_ms: float = 0.0

    @property
    def origin(self) -> str:
        """The plugin, in words: ``plugin 'divs' (trailmark 0.1.0)``."""
        return f"plugin {self.name!r} ({f'{self.distribution} {self.version}'.strip()})"

    def warning(self) -> str:
        """Return one line about a failed plugin: which, whose, why, and where to read on."""
        return f"{self.origin} did not load: {self.error}; run 'trailmark plugins doctor'"

    def is_called(self, name: str) -> bool:
        """Whether a name in a list means this plugin: its entry point, its distribution, or ``dist:entry``."""
        return name in (self.name, self.distribution, f"{self.distribution}:{self.name}")


@dataclass(frozen=True, slots=True)
class Selection:
    """What may load. A name is an entry point, a distribution, or ``distribution:entry``.

    Attributes
    ----------
    allowed : frozenset of str or None
        Nothing else but core and the files may load; None: everything may.
    blocked : frozenset of str
        These may not, whatever `allowed` says.
    files : tuple of Path
        One-file plugins, absolute.
    is_strict : bool
        Raise for the first plugin that does not load.
    """

    allowed: frozenset[str] | None = None
    blocked: frozenset[str] = frozenset()
    files: tuple[Path, ...] = ()
    is_strict: bool = False

    @classmethod
    def read(
        cls,
        block: Iterable[str] = (),
        files: Iterable[str | Path] = (),
        environment: Mapping[str, str] = os.environ,
    ) -> Selection:
        """Join names to block, one-file plugins and what the environment says.

        Raises
        ------
        ConfigError
            If a file does not exist or is no ``.py`` file.
        """
        listed = environment.get(ALLOW_VARIABLE)
        return cls(
            allowed=None if listed is None else frozenset(name.strip() for name in listed.split(",") if name.strip()),
            blocked=frozenset(block),
            files=tuple(dict.fromkeys(_plugin_file(file) for file in files)),
            is_strict=environment.get(STRICT_VARIABLE, "0") not in ("", "0"),
        )

    def verdict(self, name: str, distribution: str) -> Literal["ok", "blocked", "disabled"]:
        """Return whether a plugin may load: ``ok``, ``blocked`` by name, or ``disabled`` by the allow list."""
        if (distribution, name) == CORE:
            return "ok"
        names = {name, distribution, f"{distribution}:{name}"}
        if names & self.blocked:
            return "blocked"
        return "ok" if self.allowed is None or names & self.allowed else "disabled"


def _plugin_file(file: str | Path) -> Path:
    path = Path(file).expanduser().resolve()
    if path.suffix != ".py":
        raise ConfigError(f"plugin file {file}: a one-file plugin is a .py file")
    if not path.is_file():
        raise ConfigError(f"plugin file {file}: no such file: {path}")
    return path
