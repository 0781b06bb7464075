"""The path store: one SQLite file per taught place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

from trailmark.errors import ConfigError, StoreError
from trailmark.frames import SensorInfo
from trailmark.frames.documents import sensor_from_document, sensor_to_document
from trailmark.geometry import Pose2
from trailmark.interfaces import LocalizerMap, PathStore, Session
from trailmark.paths import Keyframe, Path, Waypoint
from trailmark.stores import map_rows, tables
from trailmark.stores.database import Database
from trailmark.stores.localizer_map import SqliteMap
from trailmark.stores.rows import check_name, pack_arrays
from trailmark.stores.sqlite_config import SqliteStoreConfig

__all__ = ["SqlitePathStore"]


class SqlitePathStore(PathStore):
    """A taught path, what localizers remember beside it, and what it was taught with, in one file.

    There is one writer at a time, in this process or another; readers are welcome while it writes and see
    what is committed. A new store stands beside its place (``F.trail.new``) until the first commit; one that replaces
    an old store, until the first commit with a waypoint: before that, nothing happened to the old one.

    Parameters
    ----------
    config : SqliteStoreConfig
        The file and how it is opened.
    """

    config: SqliteStoreConfig

    def __init__(self, config: SqliteStoreConfig) -> None:
        super().__init__(config)
        self._database: Database | None = None
        self._n_committed = 0

    def start(self, session: Session) -> None:
        """Open the file.

        Raises
        ------
        StoreError
            If it is missing, not a path store, damaged, of a newer schema, being written by another, or in the way.
        """
        self.close()
        if not self.config.path:
            raise StoreError("no path store is named; give one with --store F.trail")
        path, access = FilePath(self.config.path).resolve(), self.config.access
        if access == "read":
            database = Database.to_read(path)
        elif access == "append":
            database = Database.to_append(path)
        else:
            database = Database.to_create(path, replaces=access == "overwrite")
        try:
            with database.reading() as connection:
                self._n_committed = tables.read_totals(connection).waypoints
        except BaseException:
            database.close()
            raise
        self._database = database

    def close(self) -> None:
        """Close the file; what was not committed is forgotten."""
        database, self._database = self._database, None
        if database is not None:
            database.close()

    def append(self, waypoint: Waypoint) -> None:
        """Add the next waypoint to the open transaction.

        Raises
        ------
        StoreError
            If its index or station does not follow the last one, or the store cannot be written.
        """
        with self._open_database().writing() as connection:
            tables.add_waypoint(connection, waypoint)

    def path(self) -> Path | None:
        """Return the committed path, or None while there is none."""
        database = self._open_database()
        with database.reading() as connection:
            count = self._n_committed if database.is_writable else tables.read_totals(connection).waypoints
            waypoints = tables.read_waypoints(connection, count)
            return Path.from_arrays(waypoints[:, 0], waypoints[:, 1:]) if len(waypoints) else None

    def localizer_map(self, owner: str) -> LocalizerMap:
        """Return the localizer map of one localizer; it lives as long as the store is open."""
        check_name(owner, "a localizer map")
        return SqliteMap(self._open_database(), owner)

    def commit(self) -> None:
        """Make everything so far durable: when this returns, a kill at any instant loses none of it.

        A loss of power may cost the newest commits, but not the file. While an old store is being replaced,
        what is committed before the first waypoint is kept beside it and comes into force with that.
        """
        database = self._open_database()
        with database.exclusively():
            with database.reading() as connection:
                count = tables.read_totals(connection).waypoints
            database.commit(replaces_old=count > 0)
            self._n_committed = count

    def owners(self) -> tuple[str, ...]:
        """Return whose localizer maps there are, in the order in which they were first used."""
        with self._open_database().reading() as connection:
            return tuple(row.owner for row in map_rows.read_maps(connection))

    def move(self, waypoints: Sequence[Pose2], keyframes: Mapping[str, Sequence[Keyframe]]) -> bool:
        """Put the path, and what is remembered along it, elsewhere; all of it or nothing, with the next commit.

        Raises
        ------
        StoreError
            If there are not as many waypoints or keyframes as that, or the store cannot be written.
        """
        packed = {owner: [pack_arrays(one.arrays) for one in rows] for owner, rows in keyframes.items()}
        with self._open_database().writing() as connection:
            tables.move_waypoints(connection, waypoints)
            for owner, rows in keyframes.items():
                row = map_rows.find_map(connection, owner) or map_rows.add_map(connection, owner)
                map_rows.move_keyframes(connection, row, rows, packed[owner])
        return True

    def is_finished(self, owner: str) -> bool:
        """Return whether `Localizer.finish` ran for this owner since its localizer map last changed, or it has none."""
        with self._open_database().reading() as connection:
            row = map_rows.find_map(connection, owner)
        return row is None or row.is_finished or row.n_keyframes + row.n_saved == 0

    def mark_finished(self, owner: str) -> None:
        """Write down that `Localizer.finish` ran for this owner; part of the open transaction."""
        check_name(owner, "a localizer map")
        with self._open_database().writing() as connection:
            row = map_rows.find_map(connection, owner) or map_rows.add_map(connection, owner)
            map_rows.set_finished(connection, row, True)

    def set_sensors(self, sensors: Mapping[str, SensorInfo]) -> None:
        """Keep what is known of the sensors the path is taught with; part of the open transaction."""
        self._write("sensors", {name: sensor_to_document(sensor) for name, sensor in sensors.items()})

    def sensors(self) -> Mapping[str, SensorInfo]:
        """Return the sensors that the path was taught with, by name.

        Raises
        ------
        StoreError
            If they are not as they were written.
        """
        documents = self._read("sensors")
        try:
            return {name: sensor_from_document(document) for name, document in documents.items()}
        except ConfigError as error:
            raise StoreError(f"{self.config.path} says of its sensors what cannot be: {error}") from error

    def set_meta(self, meta: Mapping[str, Any]) -> None:
        """Keep provenance (JSON-able: versions, git, config); part of the open transaction."""
        self._write("meta", dict(meta))

    def meta(self) -> dict[str, Any]:
        """Return the provenance; empty where none was kept."""
        return self._read("meta")

    def _write(self, key: str, document: Mapping[str, Any]) -> None:
        try:
            with self._open_database().writing() as connection:
                tables.write_fact(connection, key, document)
        except (TypeError, ValueError) as error:
            raise StoreError(f"{key} of a path store must be JSON: {error}") from error

    def _read(self, key: str) -> dict[str, Any]:
        with self._open_database().reading() as connection:
            return tables.read_document(connection, key)

    def _open_database(self) -> Database:
        if self._database is None:
            raise StoreError("the path store is not open; start it first")
        return self._database
