"""What became of each plugin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from trailmark.plugins.spec import Spec

__all__ = ["PluginRecord", "Status"]

Status = Literal["ok", "failed", "blocked", "disabled"]


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
