"""From what a row of odometry holds to the way since the first row."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Collection

from trailmark.frames import Odometry
from trailmark.geometry import Pose2, Twist2
from trailmark_datasets.config import CsvOdometryConfig
from trailmark_datasets.tables import TableRow

__all__ = ["DistanceOdometer", "Odometer", "PoseOdometer", "VelocityOdometer", "WheelOdometer"]


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
        self.columns = columns

    @abstractmethod
    def step(self, stamp_s: float, row: TableRow) -> Odometry:
        """Return the odometry at a row; raises `SourceError`, and stays as it was, where a field is no number."""

    def metres(self, row: TableRow, column: str) -> float:
        """Return a length, or a velocity, of a row [m, m/s]."""
        return row.number(column) * self.config.metres_per_unit

    def radians(self, row: TableRow, column: str) -> float:
        """Return an angle, or a rate, of a row [rad, rad/s]."""
        value = row.number(column)
        return math.radians(value) if self.config.angle_unit == "deg" else value

    def twist(self, row: TableRow) -> Twist2 | None:
        """Return the velocity, where the row has one."""
        if not {"v", "omega"} <= set(self.columns):
            return None
        return Twist2(self.metres(row, "v"), 0.0, self.radians(row, "omega"))


class PoseOdometer(Odometer):
    """Columns x, y, theta: poses in a frame of the table's own."""

    _pose_table_start: Pose2 | None = None

    def step(self, stamp_s: float, row: TableRow) -> Odometry:
        """Return the pose as seen from the first row's."""
        pose = Pose2(self.metres(row, "x"), self.metres(row, "y"), self.radians(row, "theta"))
        twist = self.twist(row)
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
        twist = Twist2(self.metres(row, "v"), 0.0, self.radians(row, "omega"))
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
        left_m, right_m = self.metres(row, "left"), self.metres(row, "right")
        twist = self.twist(row)
        last_left_m, last_right_m = (0.0, 0.0) if self.config.per_row else (self._last or (left_m, right_m))
        driven = self._last is not None  # what the first row tells lies before the start
        self._last = left_m, right_m
        if driven:
            step_left_m, step_right_m = left_m - last_left_m, right_m - last_right_m
            turn_rad = (step_right_m - step_left_m) / (self.config.track_width_m or math.inf)
            self._pose = self._pose @ Pose2.exp((step_left_m + step_right_m) / 2.0, 0.0, turn_rad)
        return Odometry(self._pose, twist=twist)


class DistanceOdometer(Odometer):
    """Column distance: the way of the robot, backwards negative; where it turned is not known."""

    _start_m: float | None = None
    _sum_m = 0.0

    def step(self, stamp_s: float, row: TableRow) -> Odometry:
        """Return the distance since the first row."""
        distance_m = self.metres(row, "distance")
        if self._start_m is None:
            self._start_m = distance_m
        elif self.config.per_row:
            self._sum_m += distance_m
        return Odometry(distance_m=self._sum_m if self.config.per_row else distance_m - self._start_m)
