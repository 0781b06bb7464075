"""A path store as ordinary files: TUM, CSV, JSON and NPZ."""

from __future__ import annotations

import csv
import json
import re
import sqlite3
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import StoreError
from trailmark.geometry import Trajectory, write_tum
from trailmark.paths import Keyframe
from trailmark.stores import map_rows, tables
from trailmark.stores.database import Database

__all__ = ["export_store", "file_names"]

ArrayMap = Mapping[str, npt.NDArray[Any]]

_MAX_NAME = 80
_ZIP_EPOCH = (1980, 1, 1, 0, 0, 0)  # the same store gives the same bytes


def export_store(path: Path, folder: Path) -> list[Path]:
    """Write all that a store holds into a new or empty folder, and return the files.

    ``path.tum`` (its "time" is the station: a path has no clock), ``waypoints.csv``, ``sensors.json``,
    ``provenance.json``, and for each map ``drawers/OWNER/keyframes.npz`` and ``drawers/OWNER/saved/NAME.npz``.
    In ``keyframes.npz``, ``station_m``, ``stamp_s`` and ``pose_map_base`` have a row per keyframe, and the arrays
    of keyframe 12 are called ``000012.NAME``.

    Raises
    ------
    StoreError
        If the store cannot be read, or the folder is not empty or cannot be written.
    """
    with closing(Database.to_read(path)) as database, database.reading() as connection:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if any(folder.iterdir()):
                raise StoreError(f"{folder} is not empty; name a new folder with --out")
            return [
                *_write_path(tables.read_waypoints(connection), folder),
                _write_json(folder / "sensors.json", tables.read_document(connection, "sensors")),
                _write_json(folder / "provenance.json", tables.read_document(connection, "meta")),
                *_write_maps(connection, folder / "drawers"),
            ]
        except OSError as error:
            raise StoreError(f"cannot export to {folder}: {error.strerror or error}") from error


def file_names(names: list[str]) -> list[str]:
    """Return a file name for each name: letters, digits, ``_`` and ``-`` only, short, and no two the same.

    A store may come from a stranger, and its names may be ``../../.bashrc``.
    """
    found: list[str] = []
    taken: set[str] = set()
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_-]+", "_", name)[:_MAX_NAME] or "_"
        choice, count = plain, 1
        while choice.lower() in taken:  # also on systems that do not tell A from a
            count += 1
            choice = f"{plain}-{count}"
        taken.add(choice.lower())
        found.append(choice)
    return found


def _write_maps(connection: sqlite3.Connection, folder: Path) -> Iterator[Path]:
    maps = map_rows.read_maps(connection)
    for row, owner in zip(maps, file_names([row.owner for row in maps]), strict=True):
        keyframes = list(map_rows.read_keyframes(connection, row))
        yield _write_npz(folder / owner / "keyframes.npz", _table_of(keyframes))
        names = map_rows.saved_names(connection, row)
        for name, file_name in zip(names, file_names(names), strict=True):
            arrays = map_rows.read_saved(connection, row, name) or {}
            yield _write_npz(folder / owner / "saved" / f"{file_name}.npz", _safely_named(arrays))


def _write_json(path: Path, document: Any) -> Path:
    path.write_text(json.dumps(document, indent=1), encoding="utf-8")
    return path


def _write_path(waypoints: Floats, folder: Path) -> list[Path]:
    tum, table = folder / "path.tum", folder / "waypoints.csv"
    write_tum(tum, Trajectory(waypoints[:, 0], waypoints[:, 1:]))
    tum.write_text("# station_m x y z qx qy qz qw\n" + tum.read_text(encoding="utf-8"), encoding="utf-8")
    with table.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["index", "station_m", "x", "y", "theta"])
        writer.writerows([index, *numbers] for index, numbers in enumerate(waypoints.tolist()))
    return [tum, table]


def _table_of(keyframes: list[Keyframe]) -> ArrayMap:
    arrays: dict[str, npt.NDArray[Any]] = {
        "station_m": np.array([keyframe.station_m for keyframe in keyframes]),
        "stamp_s": np.array([keyframe.stamp_s for keyframe in keyframes]),
        "pose_map_base": np.array([keyframe.pose_map_base.array() for keyframe in keyframes]).reshape(-1, 3),
    }
    for number, keyframe in enumerate(keyframes):
        arrays |= {f"{number:06d}.{name}": array for name, array in _safely_named(keyframe.arrays).items()}
    return arrays


def _safely_named(arrays: ArrayMap) -> ArrayMap:
    return dict(zip(file_names(list(arrays)), arrays.values(), strict=True))


def _write_npz(path: Path, arrays: ArrayMap) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in arrays.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy", _ZIP_EPOCH), "w", force_zip64=True) as file:
                np.lib.format.write_array(file, array, allow_pickle=False)
    return path
