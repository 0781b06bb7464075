"""Reads sightings of landmarks."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from trailmark.errors import SourceError
from trailmark.frames import Arrays, Record, SensorInfo
from trailmark.sources import Reading, Readings, RecordedSource
from trailmark_mrclam.config import MrclamLandmarksConfig

__all__ = ["MrclamLandmarks", "read_table"]

Array = npt.NDArray[np.float64]


class MrclamLandmarks(RecordedSource):
    """One frame for all landmarks seen at one instant: arrays ``ids``, ``ranges_m``, ``bearings_rad``.

    The calibration holds ``ids`` and ``positions_map``, (N, 2) [m]. Sightings of other robots are left out.
    """

    config: MrclamLandmarksConfig

    def open_recording(self, name: str) -> Iterable[SensorInfo]:
        """Read the three tables; the one sensor is named like the source."""
        config, folder = self.config, self.config.path.parent
        landmarks = read_table(config.landmarks or folder / "Landmark_Groundtruth.dat", 5)
        barcodes = read_table(config.barcodes or folder / "Barcodes.dat", 2)
        ids = landmarks[:, 0].astype(np.int64)
        subject_of = {int(barcode): int(subject) for subject, barcode in barcodes}
        table = read_table(config.path, 4)
        subjects = np.array([subject_of.get(int(barcode), -1) for barcode in table[:, 1]], dtype=np.int64)
        is_landmark = np.isin(subjects, ids)
        self._table, self._subjects = table[is_landmark], subjects[is_landmark]
        self._name = name or "landmarks"
        calibration = Arrays({"ids": ids, "positions_map": landmarks[:, 1:3]})
        return [SensorInfo(self._name, "range_bearing", calibration=calibration)]

    def readings(self) -> Readings:
        """Yield the sightings of each instant."""
        begins = np.flatnonzero(np.diff(self._table[:, 0], prepend=np.nan) != 0.0)
        for begin, end in zip(begins, [*begins[1:], len(self._table)], strict=True):
            rows = self._table[begin:end]
            seen = Record({"ids": self._subjects[begin:end], "ranges_m": rows[:, 2], "bearings_rad": rows[:, 3]})
            where = f"{self.config.path}: sighting {begin + 1} of a landmark"
            yield Reading(self._name, float(rows[0, 0]), where, lambda seen=seen: seen)


def read_table(path: Path, n_columns: int) -> Array:
    """Read a table of numbers, ``#`` starts a comment; returns (N, n_columns).

    Raises
    ------
    SourceError
        If the file cannot be read, or a line does not hold finite numbers; the message names it.
    """
    rows = []
    try:
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            fields = line.partition("#")[0].split()
            if fields:
                rows.append(_numbers(fields, n_columns, f"{path}:{number}"))
    except (OSError, UnicodeDecodeError) as error:
        raise SourceError(f"cannot read {path}: {error}") from error
    return np.array(rows, dtype=np.float64).reshape(-1, n_columns)


def _numbers(fields: list[str], n_columns: int, where: str) -> list[float]:
    try:
        values = [float(field) for field in fields]
    except ValueError as error:
        raise SourceError(f"{where}: {error}") from None
    if len(values) != n_columns or not np.isfinite(values).all():
        raise SourceError(f"{where}: expected {n_columns} finite numbers, found {' '.join(fields)[:80]!r}")
    return values
