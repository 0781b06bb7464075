"""Candidates of a taught place, for labelling by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import ConfigError
from trailmark.interfaces import Session
from trailmark.stores import SqlitePathStore, SqliteStoreConfig

__all__ = ["stored_candidates"]


def stored_candidates(path: Path, localizer: str) -> tuple[Floats, Floats]:
    """Return the six features and the measured positions of all candidates, (N, 6) and (N, 2).

    Parameters
    ----------
    path : Path
        The path store.
    localizer : str
        Name of the localizer that remembered them.

    Raises
    ------
    ConfigError
        If that localizer left no candidates there.
    StoreError
        If the file is no path store.
    """
    store = SqlitePathStore(SqliteStoreConfig(path=str(path), access="read"))
    store.start(Session())
    try:
        saved = store.localizer_map(localizer).load("candidates")
    finally:
        store.close()
    if saved is None:
        raise ConfigError(f"{path} holds no candidates of a localizer {localizer!r}; see 'trailmark store info {path}'")
    return np.asarray(saved["features"], np.float64), np.asarray(saved["measured"], np.float64)
