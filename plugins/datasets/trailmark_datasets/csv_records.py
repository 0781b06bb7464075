"""Ranges and bearings to landmarks, from a table."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from pathlib import Path

import numpy as np

from trailmark.errors import SourceError
from trailmark.frames import Arrays, Record, SensorInfo
from trailmark.geometry import Trajectory
from trailmark.sources import Reading, Readings, RecordedSource
from trailmark_datasets.config import RECORD_COLUMNS, CsvRecordsConfig
from trailmark_datasets.posetable import poses_from_table
from trailmark_datasets.tables import DataTable, TableRow, column_names, open_table
from trailmark_datasets.textfiles import stamp

__all__ = ["CsvRecords"]

_OF_ONE_LANDMARK = re.compile(r"(range|bearing):(\d+)")


@dataclass(frozen=True, slots=True)
class _Sighting:
    """The columns of one landmark in a row: of its range and bearing, where there are any."""

    landmark: int | None
    range_column: str | None
    bearing_column: str | None


#: A bearing of 0 to 360 degrees, with some noise, is one; a number of degrees that is taken for radians is not.
_MOST_RAD = math.radians(370.0)


class CsvRecords(RecordedSource):
    """One frame for all that was seen at one instant: arrays ``ids``, ``ranges_m`` and ``bearings_rad``, (N,).

    What a row does not tell is NaN. The sensor's kind is ``range``, ``bearing`` or ``range_bearing``; its calibration
    holds ``ids`` and ``positions_map``, (N, 2) [m], where the config names the landmarks.
    """

    config: CsvRecordsConfig

    def open_recording(self, name: str) -> Iterable[SensorInfo]:
        """Read the header, the landmarks and their codes; the one sensor is named like the source."""
        config = self.config
        wide = [column for column in column_names(config.path, config.header) if _OF_ONE_LANDMARK.fullmatch(column)]
        self._name = name or "landmarks"
        self._table = open_table(config.path, (*RECORD_COLUMNS, *wide), config.header, config.columns)
        self._sightings = _sightings_of(self._table)
        self._landmark_of = {} if config.codes is None else _read_codes(config.codes, config.codes_header)
        if "t" not in self._table.columns and config.rate_hz is None:
            raise SourceError(f"{config.path}: no column t; name it in columns: {{t: ...}}, or set rate_hz")
        calibration = None if config.landmarks is None else _read_landmarks(config.landmarks, config.landmarks_header)
        return [SensorInfo(self._name, _kind_of(self._sightings), calibration=calibration)]

    def readings(self) -> Readings:
        """Yield what was seen at each instant; rows of one stamp that follow each other are one frame."""
        for stamp_s, rows in groupby(self._stamped_rows(), key=lambda item: item[0]):
            together = [row for _, row in rows]
            if stamp_s is None:
                yield from (row for row in together if isinstance(row, SourceError))
                continue
            sound = [row for row in together if isinstance(row, TableRow)]
            yield Reading(self._name, stamp_s, sound[0].where, partial(self._record, sound))

    def ground_truth(self) -> Trajectory | None:
        """Return the poses of the table `poses`."""
        return poses_from_table(self.config, [])

    def _stamped_rows(self) -> Iterator[tuple[float | None, TableRow | SourceError]]:
        """Yield the rows with their stamps; None for one that has no stamp."""
        for index, row in enumerate(self._table.rows()):
            if isinstance(row, SourceError):
                yield None, row
            elif "t" not in row.fields:
                yield index / (self.config.rate_hz or math.nan), row
            else:
                try:
                    yield stamp(row.fields["t"], self.config.time_unit, row.where), row
                except SourceError as error:
                    yield None, error

    def _record(self, rows: list[TableRow]) -> Record:
        """Return the record of the rows of one instant; raises `SourceError` where a field is no number."""
        told = [self._sighting_of(row, sighting) for row in rows for sighting in self._sightings]
        seen = np.array([values for values in told if np.isfinite(values[1:]).any()]).reshape(-1, 3)
        return Record({"ids": seen[:, 0].astype(np.int64), "ranges_m": seen[:, 1], "bearings_rad": seen[:, 2]})

    def _sighting_of(self, row: TableRow, sighting: _Sighting) -> tuple[float, float, float]:
        """Return a landmark's number, its range [m] and its bearing [rad]."""
        code = sighting.landmark
        if code is None:
            code = _whole(row, "id")
        range_m = _optional(row, sighting.range_column) * self.config.metres_per_unit
        bearing = _optional(row, sighting.bearing_column)
        if range_m < 0.0:
            raise SourceError(f"{row.where}: a range of {range_m:g} m is negative")
        bearing_rad = math.radians(bearing) if self.config.angle_unit == "deg" else bearing
        if abs(bearing_rad) > _MOST_RAD:
            hint = "" if self.config.angle_unit == "deg" else "; if the table is in degrees, set angle_unit: deg"
            raise SourceError(
                f"{row.where}: a bearing of {bearing:g} {self.config.angle_unit} is more than a turn{hint}"
            )
        landmark = self._landmark_of.get(code, -1) if self._landmark_of else code
        return landmark, range_m, bearing_rad


def _sightings_of(table: DataTable) -> list[_Sighting]:
    """Return the columns of each landmark: those of its own, or one landmark a row."""
    matches = [match for column in table.columns if (match := _OF_ONE_LANDMARK.fullmatch(column))]
    if not matches:
        told = [column if column in table.columns else None for column in ("range", "bearing")]
        if "id" not in table.columns or told == [None, None]:
            raise SourceError(
                f"{table.path}: it needs the columns id and range or bearing (a sighting a row), or range:1, bearing:1"
                " (a landmark a column); name them in header: [t, id, range, bearing]"
            )
        return [_Sighting(None, *told)]
    columns: dict[int, dict[str, str]] = {}
    for match in matches:
        columns.setdefault(int(match[2]), {})[match[1]] = match[0]
    return [_Sighting(landmark, own.get("range"), own.get("bearing")) for landmark, own in columns.items()]


def _kind_of(sightings: list[_Sighting]) -> str:
    """Return the kind of sensor that measures these quantities."""
    has_range = any(sighting.range_column for sighting in sightings)
    has_bearing = any(sighting.bearing_column for sighting in sightings)
    return "range_bearing" if has_range and has_bearing else "range" if has_range else "bearing"


def _read_landmarks(path: Path, header: tuple[str, ...] | None) -> Arrays:
    """Return ``ids`` and ``positions_map``."""
    table = open_table(path, ("id", "x", "y"), header)
    if not {"x", "y"} <= set(table.columns):
        raise SourceError(f"{path}: landmarks need the columns x and y; name them in landmarks_header: [id, x, y]")
    rows = list(_sound_rows(table))
    numbered = "id" in table.columns
    ids = [_whole(row, "id") if numbered else 1 + index for index, row in enumerate(rows)]
    if len(set(ids)) < len(ids):
        raise SourceError(f"{path}: two landmarks have one id: {next(name for name in ids if ids.count(name) > 1)}")
    positions = np.array([(row.number("x"), row.number("y")) for row in rows]).reshape(-1, 2)
    return Arrays({"ids": np.array(ids, dtype=np.int64), "positions_map": positions})


def _read_codes(path: Path, header: tuple[str, ...] | None) -> Mapping[int, int]:
    """Return the landmark of each code."""
    table = open_table(path, ("id", "code"), header)
    if set(table.columns) != {"id", "code"}:
        raise SourceError(f"{path}: codes need the columns id and code; name them in codes_header: [id, code]")
    return {_whole(row, "code"): _whole(row, "id") for row in _sound_rows(table)}


def _sound_rows(table: DataTable) -> Iterator[TableRow]:
    """Yield the rows, or raise the first error."""
    for row in table.rows():
        if isinstance(row, SourceError):
            raise row
        yield row


def _whole(row: TableRow, column: str) -> int:
    """Return a whole number of a row."""
    value = row.number(column)
    if value != int(value):
        raise SourceError(f"{row.where}: column {column!r} is {row.fields[column][:40]!r}, not a whole number")
    return int(value)


def _optional(row: TableRow, column: str | None) -> float:
    """Return the number in a column; NaN where there is no such column, or nothing in it."""
    if column is None or row.fields[column].lower() in {"", "nan"}:
        return math.nan
    return row.number(column)
