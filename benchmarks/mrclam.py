"""The drives of MRCLAM as parts of a config: wheels, barcodes at range and bearing, and where they begin."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["barcodes", "start", "wheels"]


def wheels(folder: Path, robot: int) -> dict[str, Any]:
    """Return the source of a robot's wheels, with its true poses."""
    return {
        "plugin": "csv_odometry",
        "path": str(folder / f"Robot{robot}_Odometry.dat"),
        "header": ["t", "v", "omega"],
        "poses": str(folder / f"Robot{robot}_Groundtruth.dat"),
        "poses_header": ["t", "x", "y", "theta"],
    }


def barcodes(folder: Path, robot: int) -> dict[str, Any]:
    """Return the source of the ranges and bearings of barcodes that a robot saw."""
    return {
        "plugin": "csv_records",
        "path": str(folder / f"Robot{robot}_Measurement.dat"),
        "header": ["t", "id", "range", "bearing"],
        "codes": str(folder / "Barcodes.dat"),
        "codes_header": ["id", "code"],
        "landmarks": str(folder / "Landmark_Groundtruth.dat"),
        "landmarks_header": ["id", "x", "y"],
    }


def start(folder: Path, robot: int) -> list[float]:
    """Return where a robot begins: (x, y, heading) [m, m, deg]."""
    truth = np.loadtxt(folder / f"Robot{robot}_Groundtruth.dat")
    first_s = np.loadtxt(folder / f"Robot{robot}_Odometry.dat")[0, 0]
    x, y, theta = truth[np.searchsorted(truth[:, 0], first_s), 1:4]
    return [float(x), float(y), math.degrees(theta)]
