"""A request for a run: the config, and what a command or a program says beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

from trailmark.config import RunConfig, load_run_config
from trailmark.errors import ConfigError
from trailmark.interfaces import Access, Mode
from trailmark.plugins import Plugins, load_plugins

__all__ = ["RunKeywords", "RunRequest", "read_config"]


class RunKeywords(TypedDict, total=False):
    """What may be said beside a config, as keywords of `trailmark.run` and `Pipeline`; see `RunRequest`."""

    store: str | Path | None
    mode: Mode | None
    overrides: Sequence[Any]
    plugins: Plugins | None
    access: Access | None
    overwrite: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRequest:
    """What is to be run, and how.

    Attributes
    ----------
    config : RunConfig, path or mapping
        What to run.
    out : path or None
        Folder to record into; None: nothing is recorded.
    store : path or None
        The path store, in place of the config's.
    mode : {"track", "teach", "replay"} or None
        In place of the config's.
    overrides : sequence of str
        As ``--set``: ``"localizers.floor.search_px=8"``.
    plugins : Plugins or None
        What a config may name; None: all that are installed.
    access : {"create", "append", "overwrite"} or None
        How teaching opens the path store; None: as its config says, or ``create``.
    overwrite : bool
        Whether `out` may hold an earlier run.
    """

    config: RunConfig | str | Path | Mapping[str, Any]
    out: str | Path | None = None
    store: str | Path | None = None
    mode: Mode | None = None
    overrides: Sequence[Any] = ()
    plugins: Plugins | None = None
    access: Access | None = None
    overwrite: bool = False

    @property
    def name(self) -> str:
        """What a folder for the run is called after: the config's file, or ``run``."""
        return Path(self.config).stem if isinstance(self.config, str | Path) else "run"

    def read(self) -> RunConfig:
        """Return the config, loaded where it is not yet, with mode and path store of the request.

        Raises
        ------
        ConfigError
            If the config is wrong; one line for each thing.
        """
        if self.plugins is not None and not isinstance(self.plugins, Plugins):
            kind = type(self.plugins).__name__
            raise ConfigError(f"plugins: takes what trailmark.plugins.load_plugins(files=[...]) returns, not {kind}")
        if isinstance(self.config, RunConfig):
            config = self.config if self.mode is None else self.config.with_mode(self.mode)
            return config if self.store is None else config.with_store(Path(self.store).absolute())
        changes = list(self.overrides)
        if self.store is not None:
            changes.append(("path_store.path", str(Path(self.store).absolute())))
        return load_run_config(self.config, plugins=self.plugins or load_plugins(), overrides=changes, mode=self.mode)


def read_config(
    config: RunConfig | str | Path | Mapping[str, Any], *, plugins: Plugins | None = None, overrides: Sequence[Any] = ()
) -> RunConfig:
    """Return a config, loaded where it is not yet.

    Raises
    ------
    ConfigError
        If the config is wrong; one line for each thing.
    """
    return RunRequest(config=config, plugins=plugins, overrides=overrides).read()
