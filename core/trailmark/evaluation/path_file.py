"""``taught_path.csv`` in the folder of a run: the path that its path offsets are about."""

from __future__ import annotations

import csv
from pathlib import Path

from trailmark import paths
from trailmark.errors import DataError, ShapeError
from trailmark.evaluation.number_rows import read_number_rows
from trailmark.geometry import Pose2

__all__ = ["PATH_FILE", "read_path", "write_path"]

PATH_FILE = "taught_path.csv"
_COLUMNS = ("station_m", "x", "y", "theta")


def write_path(path: paths.Path, file: Path) -> None:
    """Write the waypoints of a path, one a line.

    Raises
    ------
    DataError
        If the file cannot be written.
    """
    rows = [(point.station_m, *point.pose_map_base.array().tolist()) for point in path.waypoints]
    try:
        with open(file, "w", encoding="utf-8", newline="") as target:
            csv.writer(target).writerows([_COLUMNS, *rows])
    except OSError as error:
        raise DataError(f"cannot write {file}: {error.strerror or error}") from error


def read_path(file: Path) -> paths.Path:
    """Read what `write_path` wrote.

    Raises
    ------
    DataError
        If it cannot be read or is no such table.
    """
    rows = read_number_rows(file, _COLUMNS, "a taught path")
    try:
        return paths.Path(
            paths.Waypoint(index, station_m, Pose2(x, y, theta)) for index, (station_m, x, y, theta) in enumerate(rows)
        )
    except (ValueError, ShapeError) as error:
        raise DataError(f"{file} is not a taught path: {error}") from error
