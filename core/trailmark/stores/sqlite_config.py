"""Configuration of the SQLite path store."""

from __future__ import annotations

from typing import Literal

from trailmark.config.base import PluginConfig

__all__ = ["SqliteStoreConfig"]


class SqliteStoreConfig(PluginConfig):
    """One file per taught place. The commands fill this in: ``--store``, ``--append``, ``--overwrite``."""

    path: str = ""
    """The file, usually ``*.trail``."""
    access: Literal["read", "create", "append", "overwrite"] = "read"
    """Read a store, make a new one, go on with an old one, or replace it once something new is committed."""
