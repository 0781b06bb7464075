"""Odometry from a table."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

from trailmark.errors import SourceError
from trailmark.frames import SensorInfo
from trailmark.geometry import Trajectory
from trailmark.sources import Reading, Readings, RecordedSource
from trailmark_datasets.config import ODOMETRY_COLUMNS, CsvOdometryConfig
from trailmark_datasets.odometers import (
    DistanceOdometer,
    Odometer,
    PoseOdometer,
    VelocityOdometer,
    WheelOdometer,
)
from trailmark_datasets.posetable import poses_from_table
from trailmark_datasets.tables import DataTable, open_table
from trailmark_datasets.textfiles import stamp

__all__ = ["CsvOdometry"]

#: Columns that each quantity needs beside t, in the order in which they are looked for, and what reads them.
QUANTITIES: dict[str, tuple[tuple[str, ...], type[Odometer]]] = {
    "pose": (("x", "y", "theta"), PoseOdometer),
    "wheels": (("left", "right"), WheelOdometer),
    "velocity": (("v", "omega"), VelocityOdometer),
    "distance": (("distance",), DistanceOdometer),
}


class CsvOdometry(RecordedSource):
    """Poses, wheel distances, velocities or distances; every frame says the way since the first row."""

    config: CsvOdometryConfig
    _name = ""
    _table: DataTable
    _quantity = "pose"

    def open_recording(self, name: str) -> Iterable[SensorInfo]:
        self._name = name or "odometry"
        self._table = open_table(self.config.path, ODOMETRY_COLUMNS, self.config.header, self.config.columns)
        self._quantity = _quantity_of(self._table, self.config)
        return (SensorInfo(self._name, "odometry"),)

    def readings(self) -> Readings:
        odometer = QUANTITIES[self._quantity][1](self.config, self._table.columns)
        for row in self._table.rows():
            if isinstance(row, SourceError):
                yield row
                continue
            try:
                stamp_s = stamp(row.fields["t"], self.config.time_unit, row.where)
            except SourceError as error:
                yield error
                continue
            yield Reading(self._name, stamp_s, row.where, partial(odometer.step, stamp_s, row))

    def ground_truth(self) -> Trajectory | None:
        """Return the poses of the table `poses`."""
        return poses_from_table(self.config, [])


def _quantity_of(table: DataTable, config: CsvOdometryConfig) -> str:
    if "t" not in table.columns:
        raise SourceError(f"{table.path}: no column t; name the one that holds the stamps in columns: {{t: ...}}")
    if config.quantity is not None:
        missing = [name for name in QUANTITIES[config.quantity][0] if name not in table.columns]
        if missing:
            raise SourceError(f"{table.path}: quantity {config.quantity} needs the columns {', '.join(missing)}")
        found: str = config.quantity
    else:
        fitting = [name for name, (needed, _) in QUANTITIES.items() if set(needed) <= set(table.columns)]
        if not fitting:
            choices = "; ".join(", ".join(needed) for needed, _ in QUANTITIES.values())
            raise SourceError(f"{table.path}: besides t it needs columns {choices}; name them in columns: {{v: ...}}")
        found = fitting[0]
    if found == "wheels" and config.track_width_m is None:
        raise SourceError(f"{table.path}: columns left, right need track_width_m, the distance between the wheels")
    return found
