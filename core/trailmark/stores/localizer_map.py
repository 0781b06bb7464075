"""One localizer's own place in a path store."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.interfaces import LocalizerMap
from trailmark.paths import Keyframe
from trailmark.stores import map_rows
from trailmark.stores.database import Database
from trailmark.stores.rows import check_name, pack_arrays

__all__ = ["SqliteMap"]


class SqliteMap(LocalizerMap):
    """A localizer map in an SQLite store.

    Arrays that it is given are packed by the calling thread, before the store is locked.

        What the writer has added is seen by its own `keyframes` and `load` at once, and by other programs once
    committed. Arrays come back read-only.

    Parameters
    ----------
    database : Database
        The open file.
    owner : str
        Name of the localizer.
    """

    def __init__(self, database: Database, owner: str) -> None:
        self._database = database
        self._owner = owner

    def add(self, keyframe: Keyframe) -> None:
        """Remember a keyframe; it is committed with the waypoint that follows it.

        Raises
        ------
        ShapeError
            If its arrays cannot be stored, or its station or stamp is not finite.
        StoreError
            If the store is open for reading only, or cannot be written any more.
        """
        layout, data = pack_arrays(keyframe.arrays)
        with self._database.writing() as connection:
            row = map_rows.find_map(connection, self._owner) or map_rows.add_map(connection, self._owner)
            map_rows.add_keyframe(connection, row, keyframe, layout, data)

    def keyframes(self) -> Sequence[Keyframe]:
        """Return all keyframes in the order in which they were added.

        Raises
        ------
        StoreError
            If one of them is not as it was written.
        """
        with self._database.reading() as connection:
            row = map_rows.find_map(connection, self._owner)
            return () if row is None else tuple(map_rows.read_keyframes(connection, row))

    def save(self, name: str, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Store named arrays under a name, replacing what stood there.

        Raises
        ------
        ShapeError
            If the name or the arrays cannot be stored.
        StoreError
            If the store is open for reading only, or cannot be written any more.
        """
        check_name(name, "saved arrays")
        layout, data = pack_arrays({key: np.asarray(array) for key, array in arrays.items()})
        with self._database.writing() as connection:
            row = map_rows.find_map(connection, self._owner) or map_rows.add_map(connection, self._owner)
            map_rows.save_arrays(connection, row, name, layout, data)

    def load(self, name: str) -> Mapping[str, npt.NDArray[Any]] | None:
        """Return the arrays saved under a name, or None.

        Raises
        ------
        StoreError
            If they are not as they were written.
        """
        with self._database.reading() as connection:
            row = map_rows.find_map(connection, self._owner)
            return None if row is None else map_rows.read_saved(connection, row, name)
