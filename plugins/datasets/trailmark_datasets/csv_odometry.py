"""Odometry from a table: from what a row holds to the way since the first row."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable
from functools import partial

from trailmark.errors import SourceError
from trailmark.frames import Odometry, SensorInfo
from trailmark.geometry import Pose2, Trajectory, Twist2
from trailmark.sources import Reading, Readings, RecordedSource
from trailmark_datasets.config import ODOMETRY_COLUMNS, CsvOdometryConfig
from trailmark_datasets.posetable import poses_from_table
from trailmark_datasets.tables import DataTable, TableRow, open_table
from trailmark_datasets.textfiles import stamp

__all__ = ["CsvOdometry"]


class Odometer(ABC):
    """Takes the rows in order of their stamps.

    Parameters
    ----------
    config : CsvOdometryConfig
        Units and conventions.
    columns : collection of str
        The columns that are there.
    """

    def __init__(self, config: CsvOdometryConfig, columns: Collection[str]) -> None:
        self.config = config
        self.metres = config.metres_per_unit
        self.radians = math.radians(1.0) if config.angle_unit == "deg" else 1.0
        self.has_twist = {"v", "omega"} <= set(columns)

    @abstractmethod
    def step(self, stamp_s: float, row: TableRow) -> Odometry:
        """Return the odometry at a row; raises `SourceError`, and stays as it was, where a field is no number."""

    def twist(self, row: TableRow) -> Twist2:
        """Return the velocity of a row."""
        return Twist2(row.number("v") * self.metres, 0.0, row.number("omega") * self.radians)


class PoseOdometer(Odometer):
    """Columns x, y, theta: poses in a frame of the table's own."""

    _pose_table_start: Pose2 | None = None

    def step(self, stamp_s: float, row: TableRow) -> Odometry:
        """Return the pose as seen from the first row's."""
        x_m, y_m = row.number("x") * self.metres, row.number("y") * self.metres
        pose = Pose2(x_m, y_m, row.number("theta") * self.radians)
        twist = self.twist(row) if self.has_twist else None
        self._pose_table_start = self._pose_table_start or pose
        return Odometry(self._pose_table_start.inverse() @ pose, twist=twist)


class VelocityOdometer(Odometer):
    """Columns v, omega: ``pose_k+1 = pose_k exp(v dt, 0, omega dt)``, exact for a velocity that holds.

    With ``hold: forward`` the velocity of the earlier of two rows holds between them, with ``backward`` that of
    the later one.
    """

    _pose = Pose2()
    _last: tuple[float, Twist2] | None = None

    def step(self, stamp_s: float, row: TableRow) -> Odometry:
        """Return the integral up to the row."""
        twist = self.twist(row)
        if self._last is not None:
            last_s, last_twist = self._last
            held = last_twist if self.config.hold == "forward" else twist
            self._pose = self._pose @ held.after(stamp_s - last_s)
        self._last = stamp_s, twist
        return Odometry(self._pose, twist=twist)


class WheelOdometer(Odometer):
    """Columns left, right: way of each wheel; between two rows the robot drives an arc.

    ``d = (dl + dr) / 2``, ``dtheta = (dr - dl) / track``.
    """

    _pose = Pose2()
    _last: tuple[float, float] | None = None

    def step(self, stamp_s: float, row: TableRow) -> Odometry:
        """Return the pose after the row."""
        left_m, right_m = row.number("left") * self.metres, row.number("right") * self.metres
        twist = self.twist(row) if self.has_twist else None
        last_left_m, last_right_m = (0.0, 0.0) if self.config.per_row else (self._last or (left_m, right_m))
        driven = self._last is not None  # what the first row tells lies before the start
        self._last = left_m, right_m
        if driven:
            step_left_m, step_right_m = left_m - last_left_m, right_m - last_right_m
            turn_rad = (step_right_m - step_left_m) / (self.config.track_width_m or math.inf)
            self._pose = self._pose @ Pose2.exp((step_left_m + step_right_m) / 2.0, 0.0, turn_rad)
        return Odometry(self._pose, twist=twist)


class ArcOdometer(Odometer):
    """Columns distance, turn: way of the robot and its turn; between two rows it drives an arc."""

    _pose = Pose2()
    _last: tuple[float, float] | None = None

    def step(self, stamp_s: float, row: TableRow) -> Odometry:
        """Return the pose after the row."""
        way_m, turn_rad = row.number("distance") * self.metres, row.number("turn") * self.radians
        twist = self.twist(row) if self.has_twist else None
        last_m, last_rad = (0.0, 0.0) if self.config.per_row else (self._last or (way_m, turn_rad))
        if self._last is not None:  # what the first row tells lies before the start
            self._pose = self._pose @ Pose2.exp(way_m - last_m, 0.0, turn_rad - last_rad)
        self._last = way_m, turn_rad
        return Odometry(self._pose, twist=twist)


class DistanceOdometer(Odometer):
    """Column distance: the way of the robot, backwards negative; where it turned is not known."""

    _start_m: float | None = None
    _sum_m = 0.0

    def step(self, stamp_s: float, row: TableRow) -> Odometry:
        """Return the distance since the first row."""
        distance_m = row.number("distance") * self.metres
        if self._start_m is None:
            self._start_m = distance_m
        elif self.config.per_row:
            self._sum_m += distance_m
        return Odometry(distance_m=self._sum_m if self.config.per_row else distance_m - self._start_m)


#: Columns that each quantity needs beside t, in the order in which they are looked for, and what reads them.
QUANTITIES: dict[str, tuple[tuple[str, ...], type[Odometer]]] = {
    "pose": (("x", "y", "theta"), PoseOdometer),
    "wheels": (("left", "right"), WheelOdometer),
    "velocity": (("v", "omega"), VelocityOdometer),
    "arc": (("distance", "turn"), ArcOdometer),
    "distance": (("distance",), DistanceOdometer),
}


class CsvOdometry(RecordedSource):
    """Poses, wheel distances, velocities, arcs or distances; every frame says the way since the first row."""

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
