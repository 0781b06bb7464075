"""What a path store holds, in numbers."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

from trailmark.stores import map_rows, tables
from trailmark.stores.database import Database

__all__ = ["describe_store"]


def describe_store(path: Path) -> dict[str, Any]:
    """Return what a store holds, as a mapping for JSON.

    Raises
    ------
    StoreError
        If the file cannot be read as a path store.
    """
    with closing(Database.to_read(path)) as database, database.reading() as connection:
        stations = tables.read_waypoints(connection)[:, 0]
        return {
            "path": str(path),
            "bytes": path.stat().st_size,
            "schema": database.schema,
            "waypoints": len(stations),
            "length_m": float(stations[-1] - stations[0]) if len(stations) else 0.0,
            "drawers": [_describe_map(connection, row) for row in map_rows.read_maps(connection)],
            "sensors": tables.read_document(connection, "sensors"),
            "provenance": tables.read_document(connection, "meta"),
        }


def _describe_map(connection: sqlite3.Connection, row: map_rows.MapRow) -> dict[str, Any]:
    query = "SELECT coalesce(sum(length(data)), 0) FROM {} WHERE drawer = ?"
    (n_bytes,) = connection.execute(query.format("keyframes"), (row.id,)).fetchone()
    (n_saved_bytes,) = connection.execute(query.format("saved"), (row.id,)).fetchone()
    return {
        "owner": row.owner,
        "keyframes": row.n_keyframes,
        "keyframe_bytes": n_bytes,
        "saved": map_rows.saved_names(connection, row),
        "saved_bytes": n_saved_bytes,
        "finished": row.is_finished,
    }
