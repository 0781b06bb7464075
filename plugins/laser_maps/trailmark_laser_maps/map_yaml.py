"""Read and write maps as ROS keeps them: a picture, and ``map.yaml`` that says what it means.

The rules are those of ``map_server`` (ROS 1) and ``nav2_map_server``; where the two differ (scale mode), ROS 2's.
"""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.arrays import AnyArray, Floats
from trailmark.config import read_document
from trailmark.errors import ConfigError, ShapeError, SourceError
from trailmark.geometry import Pose2
from trailmark.sources.pictures import read_raw
from trailmark.writing import write_whole
from trailmark_laser_maps.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

__all__ = ["cells_of_picture", "read_map", "write_map"]

logger = logging.getLogger(__name__)

#: What map_saver paints; 205 is unknown only with a free threshold of at most 0.196, which Nav2's own 0.25 is not.
_PAINTED_OCCUPIED, _PAINTED_FREE, _PAINTED_UNKNOWN = 0, 254, 205
_OCCUPIED_THRESH, _FREE_THRESH = 0.65, 0.196
#: What ROS 2 takes where the file leaves it out.
_DEFAULTS = {"occupied_thresh": 0.65, "free_thresh": 0.25}
_MODES = ("trinary", "scale", "raw")
#: Sides of a cell that some plan of a building has [m].
_RESOLUTIONS_M = 1e-3, 10.0
#: A pgm or ppm with binary pixels, and the number that is white in it; OpenCV scales those with written ones alone.
_BINARY_PNM = re.compile(rb"P[56](?:(?:\s|#[^\n]*\n)+\d+){2}(?:\s|#[^\n]*\n)+(\d+)")
_WHOLE_TURN_RAD = 2.0 * math.pi


def read_map(path: Path) -> OccupancyGrid:
    """Return the map of a ``map.yaml`` and the picture that it names (pgm, png, bmp).

    Raises
    ------
    ConfigError
        With file and key, if a key is missing or wrong, or the picture cannot be read.
    """
    keys = read_document(path, what="map").data
    resolution_m = _number(path, keys, "resolution")
    if not _RESOLUTIONS_M[0] <= resolution_m <= _RESOLUTIONS_M[1]:
        raise ConfigError(
            f"{path}: resolution is {resolution_m:g}; it is the side of a cell in metres,"
            f" {_RESOLUTIONS_M[0]:g} to {_RESOLUTIONS_M[1]:g}"
        )
    mode = str(keys.get("mode", "trinary")).lower()
    if mode not in _MODES:
        raise ConfigError(f"{path}: mode is {mode!r}; it is one of {', '.join(_MODES)}")
    occupied, free = (_number(path, {**_DEFAULTS, **keys}, key) for key in ("occupied_thresh", "free_thresh"))
    if occupied > 1.0:
        raise ConfigError(f"{path}: occupied_thresh is {occupied:g}; it is a share, 0 to 1, and no percentage")
    if free >= occupied:
        raise ConfigError(
            f"{path}: free_thresh is {free:g} and occupied_thresh {occupied:g}; the first is the lower one"
        )
    picture = _read_picture(path, keys.get("image"))
    cells = cells_of_picture(picture, mode=mode, negates=_flag(path, keys), thresholds=(free, occupied))
    if mode == "raw" and not (cells > FREE).any():
        logger.warning(
            "%s: mode raw takes pixels for values of cells, 0 to 100, and none is above 0: with a picture of greys the"
            " mode is trinary",
            path,
        )
    try:
        return OccupancyGrid(cells, resolution_m, _origin(path, keys.get("origin")))
    except ShapeError as error:
        raise ConfigError(f"{path}: {error}") from error


def cells_of_picture(
    picture: AnyArray, *, mode: str = "trinary", negates: bool = False, thresholds: tuple[float, float] = (0.25, 0.65)
) -> npt.NDArray[np.int8]:
    """Return what the pixels of a map mean, (H, W) int8, the first row at the bottom.

    Parameters
    ----------
    picture : (H, W) or (H, W, 1 to 4) uint8 or uint16
        Pixels, the first row at the top, alpha last.
    mode : {"trinary", "scale", "raw"}
        Occupied, free or unknown; probabilities between the thresholds; or the values themselves.
    negates : bool
        Whether white is occupied.
    thresholds : (float, float)
        Below the first a cell is free, above the second occupied.
    """
    darkness, alpha = _darkness(picture, averages_alpha=mode == "trinary")
    darkness = np.flipud(darkness)
    if mode == "raw":
        values = np.rint((1.0 - darkness) * 255.0)  # of the pixels, whatever `negate` says
        return np.where(values <= OCCUPIED, values, UNKNOWN).astype(np.int8)
    if negates:
        darkness = 1.0 - darkness
    free, occupied = thresholds
    between = np.full(darkness.shape, float(UNKNOWN))
    if mode == "scale":
        between = np.rint((darkness - free) / max(occupied - free, 1e-12) * OCCUPIED)
    cells = np.where(darkness > occupied, OCCUPIED, np.where(darkness < free, FREE, between))
    if mode == "scale":
        cells = np.where(np.flipud(alpha) < 1.0, UNKNOWN, cells)  # before the thresholds, as in Nav2's map_io
    return np.ascontiguousarray(cells.astype(np.int8))


def write_map(path: Path, grid: OccupancyGrid) -> Path:
    """Write ``map.yaml`` and beside it a pgm of the same name, as ``map_saver`` does; return the picture's path.

    Both are whole or not there; the picture comes first, so that the yaml never names one that is not there.
    """
    picture = path.with_suffix(".pgm")
    painted = np.full(grid.cells.shape, _PAINTED_UNKNOWN, np.uint8)
    painted[grid.is_free] = _PAINTED_FREE
    painted[grid.is_occupied] = _PAINTED_OCCUPIED
    height, width = grid.cells.shape
    origin = grid.pose_map_grid
    lines = (
        f"image: {picture.name}",
        "mode: trinary",
        f"resolution: {grid.resolution_m:.6g}",
        f"origin: [{origin.x:.6f}, {origin.y:.6f}, {origin.theta:.6f}]",
        "negate: 0",
        f"occupied_thresh: {_OCCUPIED_THRESH}",
        f"free_thresh: {_FREE_THRESH}",
    )
    try:
        write_whole(picture, f"P5\n{width} {height}\n255\n".encode() + np.flipud(painted).tobytes())
        write_whole(path, "\n".join(lines) + "\n")
    except OSError as error:
        raise ConfigError(f"cannot write {error.filename or path}: {error.strerror or error}") from error
    return picture


def _darkness(picture: AnyArray, *, averages_alpha: bool) -> tuple[Floats, Floats]:
    """Return darkness and opacity of every pixel, both 0 to 1; trinary maps count alpha as a colour, as ROS does."""
    most = float(np.iinfo(picture.dtype).max)
    channels = np.atleast_3d(picture).astype(np.float64) / most
    has_alpha = channels.shape[2] in (2, 4)
    alpha = channels[:, :, -1] if has_alpha else np.ones(channels.shape[:2])
    colours = channels[:, :, :-1] if has_alpha and not averages_alpha else channels
    return 1.0 - colours.mean(axis=2), alpha


def _number(path: Path, keys: Mapping[str, Any], key: str) -> float:
    value = keys.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value <= 0:
        raise ConfigError(
            f"{path}: {key} is {'missing' if value is None else repr(value)[:40]}; it is a number above 0"
        )
    return float(value)


def _flag(path: Path, keys: Mapping[str, Any]) -> bool:
    value = keys.get("negate", 0)
    if value not in (0, 1):
        raise ConfigError(f"{path}: negate is {value!r}; it is 0 or 1")
    return bool(value)


def _origin(path: Path, value: Any) -> Pose2:
    try:
        origin = Pose2.from_array(value)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{path}: origin is {value!r}; it is [x, y, yaw]") from error
    if abs(float(value[2])) > _WHOLE_TURN_RAD:
        raise ConfigError(f"{path}: the yaw of origin is {float(value[2]):g}; it is in radians, not in degrees")
    return origin


def _read_picture(path: Path, name: Any) -> AnyArray:
    if not isinstance(name, str) or not name:
        raise ConfigError(f"{path}: image is {name!r}; it is the name of a pgm or png")
    picture_path = path.parent / name
    try:
        picture = read_raw(picture_path, f"{path}: its image {picture_path}")
    except SourceError as error:
        raise ConfigError(str(error)) from error
    if picture.dtype not in (np.uint8, np.uint16):
        raise ConfigError(f"{path}: its image {picture_path} has pixels of {picture.dtype}; 8 or 16 bits are read")
    return _to_full_range(picture, picture_path)


def _to_full_range(picture: AnyArray, path: Path) -> AnyArray:
    """Return the pixels of a binary pgm whose white is less than the largest number, scaled as ROS's loaders do."""
    with path.open("rb") as file:
        header = _BINARY_PNM.match(file.read(1024))
    white, most = int(header[1]) if header else 0, int(np.iinfo(picture.dtype).max)
    if not 0 < white < most:
        return picture
    return np.rint(np.minimum(picture, white) * (most / white)).astype(picture.dtype)
