"""Where taught paths are kept."""

from trailmark.stores.sqlite import SqlitePathStore
from trailmark.stores.sqlite_config import SqliteStoreConfig

__all__ = ["SqlitePathStore", "SqliteStoreConfig"]
