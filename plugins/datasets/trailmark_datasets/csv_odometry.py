"""Odometry from a table: from what a row holds to the way since the first row."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable
from functools import partial

from trailmark.errors import SourceError
from trailmark.frames import Odometry, SensorInfo
from trailmark.geometry import Pose2, Trajectory, Twist2, wrap_angle
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


class ArcOdometer(Odometer):
    """Columns distance, turn: way of the robot and its turn; between two rows it drives an arc.

    A turn since the start may count on or be wrapped: within a turn it goes the shorter way to the next row.
    """

    _pose = Pose2()
    _last: tuple[float, float] | None = None

    def step(self, stamp_s: float, row: TableRow) -> Odometry:
        """Return the pose after the row."""
        way_m, turn_rad = self.way_and_turn(row)
        twist = self.twist(row) if self.has_twist else None
        last, self._last = self._last, (way_m, turn_rad)
        if last is not None:  # what the first row tells lies before the start
            if not self.config.per_row:
                way_m, turn_rad = way_m - last[0], self.turn_between(last[1], turn_rad)
            try:
                self._pose = self._pose @ Pose2.exp(way_m, 0.0, turn_rad)
            except ValueError as error:
                raise SourceError(
                    f"{row.where}: a way of {way_m:g} m and a turn of {turn_rad:g} rad: {error}"
                ) from error
        return Odometry(self._pose, twist=twist)

    def way_and_turn(self, row: TableRow) -> tuple[float, float]:
        """Return what a row says, since the row before or since the start [m, rad]."""
        return row.number("distance") * self.metres, row.number("turn") * self.radians

    def turn_between(self, before_rad: float, now_rad: float) -> float:
        """Return the turn between two rows that say it since the start [rad]."""
        turn_rad = now_rad - before_rad
        return wrap_angle(turn_rad) if max(abs(before_rad), abs(now_rad)) <= math.tau else turn_rad


class WheelOdometer(ArcOdometer):
    """Columns left, right: way of each wheel, ``d = (dl + dr) / 2``, ``dtheta = (dr - dl) / track``."""

    def way_and_turn(self, row: TableRow) -> tuple[float, float]:
        """Return the way and the turn of base."""
        left_m, right_m = row.number("left") * self.metres, row.number("right") * self.metres
        return (left_m + right_m) / 2.0, (right_m - left_m) / (self.config.track_width_m or math.inf)

    def turn_between(self, before_rad: float, now_rad: float) -> float:
        """Return the difference: wheels count on, however often base has turned."""
        return now_rad - before_rad


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
            if not self.config.per_row:
                yield Reading(self._name, stamp_s, row.where, partial(odometer.step, stamp_s, row))
                continue
            try:  # now: the way of a row whose stamp is repeated is driven all the same
                odometry = odometer.step(stamp_s, row)
            except SourceError as error:
                yield error
            else:
                yield Reading(self._name, stamp_s, row.where, partial(_itself, odometry))

    def ground_truth(self) -> Trajectory | None:
        """Return the poses of the table `poses`."""
        return poses_from_table(self.config, [])


def _itself(odometry: Odometry) -> Odometry:
    return odometry


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
