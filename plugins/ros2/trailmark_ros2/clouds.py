"""A planar slice of a cloud of points, as a scan."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import SourceError
from trailmark.frames import Scan

__all__ = ["points_of", "slice_as_scan"]

_CODES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}


def points_of(message: Any, where: str) -> Floats:
    """Return the points of a PointCloud2, (N, 3) in the sensor's axes [m].

    Raises
    ------
    SourceError
        If it has no x, y, z, or its bytes are not what it says.
    """
    fields = {field.name: field for field in message.fields}
    if not {"x", "y", "z"} <= fields.keys():
        raise SourceError(f"{where}: a cloud without x, y, z; it has {', '.join(fields) or 'no field'}")
    order = ">" if message.is_bigendian else "<"
    step, row_step = int(message.point_step), int(message.row_step)
    width, height = int(message.width), int(message.height)
    data = np.ascontiguousarray(message.data).view(np.uint8).ravel()
    if step <= 0 or row_step < width * step or len(data) < height * row_step:
        raise SourceError(f"{where}: {len(data)} bytes are no cloud of {width}x{height} points of {step} bytes")
    rows = data[: height * row_step].reshape(height, row_step)[:, : width * step].reshape(height * width, step)
    columns = []
    for name in ("x", "y", "z"):
        field = fields[name]
        if int(field.datatype) not in _CODES:
            raise SourceError(f"{where}: field {name} is of an unknown type {field.datatype}")
        dtype = np.dtype(order + _CODES[int(field.datatype)])
        if int(field.offset) + dtype.itemsize > step:
            raise SourceError(f"{where}: field {name} reaches beyond its point")
        part = np.ascontiguousarray(rows[:, int(field.offset) : int(field.offset) + dtype.itemsize])
        columns.append(part.view(dtype).ravel().astype(np.float64))
    points: Floats = np.stack(columns, axis=1)
    return points[np.isfinite(points).all(axis=1)]


def slice_as_scan(points: npt.NDArray[np.float64], height_m: tuple[float, float], angle_step_rad: float) -> Scan:
    """Return the nearest point in each direction of those between two heights, all around.

    Parameters
    ----------
    points : (N, 3) float64
        In the sensor's axes [m].
    height_m : (float, float)
        Lowest and highest z [m].
    angle_step_rad : float
        Angle between beams; made to divide a full turn [rad].
    """
    n_beams = max(1, round(2.0 * math.pi / angle_step_rad))
    step_rad = 2.0 * math.pi / n_beams
    inside = points[(points[:, 2] >= height_m[0]) & (points[:, 2] <= height_m[1])]
    ranges_m = np.full(n_beams, np.inf)
    beams = np.floor((np.arctan2(inside[:, 1], inside[:, 0]) + math.pi) / step_rad + 0.5).astype(np.intp) % n_beams
    np.minimum.at(ranges_m, beams, np.hypot(inside[:, 0], inside[:, 1]))
    ranges_m[~np.isfinite(ranges_m)] = np.nan
    return Scan(ranges_m.astype(np.float32), -math.pi, step_rad)
