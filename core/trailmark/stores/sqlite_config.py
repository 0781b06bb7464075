"""Configuration of the SQLite path store."""

from __future__ import annotations

from trailmark.config.base import PluginConfig
from trailmark.interfaces import Access

__all__ = ["SqliteStoreConfig"]


class SqliteStoreConfig(PluginConfig):
    """One file per taught place. The commands fill this in: ``--store``, ``--append``, ``--overwrite``."""

    path: str = ""
    """The file, usually ``*.trail``."""
    access: Access = "read"
    """Read a store, make a new one, go on with an old one, or replace it once something new is committed."""
