"""Which plugins may load: options of the command line and variables of the environment."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from trailmark.errors import ConfigError

__all__ = ["ALLOW_VARIABLE", "CORE", "STRICT_VARIABLE", "Selection"]

#: Names of the plugins that may load, separated by commas; empty: none but core.
ALLOW_VARIABLE = "TRAILMARK_PLUGINS"

#: Set to anything but 0: the first plugin that does not load ends the program.
STRICT_VARIABLE = "TRAILMARK_STRICT_PLUGINS"

#: Entry point of the parts that every run needs; it cannot be blocked.
CORE = ("trailmark", "core")


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
        """Say whether a plugin may load: ``ok``, ``blocked`` by name, or ``disabled`` by the allow list."""
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
