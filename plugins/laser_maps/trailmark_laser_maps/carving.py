"""From scans at known poses to an occupancy grid: free along each ray, occupied at its end."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats, Int32s
from trailmark.errors import ShapeError
from trailmark.geometry import Pose2
from trailmark.kernels import kernel
from trailmark_laser_maps.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

__all__ = ["PlacedScan", "carve_grid"]

_MARGIN_CELLS = 10


@dataclass(frozen=True, slots=True, eq=False)
class PlacedScan:
    """Where the rays of one scan begin and end.

    Attributes
    ----------
    laser : (2,) float64
        Where they begin, in the map [m].
    ends : (N, 2) float64
        Where they end, in the map [m].
    """

    laser: Floats
    ends: Floats

    @classmethod
    def at(cls, pose_map_base: Pose2, points_base: Floats, laser_base: tuple[float, float]) -> PlacedScan:
        """Return the scan with points in base axes (N, 2), taken from `laser_base`, at a pose."""
        return cls(pose_map_base @ np.array(laser_base), pose_map_base @ points_base)


def carve_grid(
    scans: Iterable[PlacedScan], *, resolution_m: float = 0.05, min_hits: int = 2, min_share: float = 0.25
) -> OccupancyGrid:
    """Return the grid of scans: a cell is occupied where enough rays end, of those that reach it.

    Parameters
    ----------
    scans : iterable of PlacedScan
        At least one with a point.
    resolution_m : float
        Side of a cell [m].
    min_hits : int
        So many rays at least end in an occupied cell.
    min_share : float
        And this share of the rays that end in it or pass through it: what walked by is passed through later.

    Raises
    ------
    ShapeError
        If no scan holds a point.
    """
    placed = [scan for scan in scans if len(scan.ends)]
    if not placed:
        raise ShapeError("the scans hold no points, so there is no map to draw")
    corners = np.concatenate([np.vstack([scan.ends, scan.laser[np.newaxis]]) for scan in placed])
    low = (np.floor(corners.min(axis=0) / resolution_m) - _MARGIN_CELLS) * resolution_m
    width, height = (np.ceil((corners.max(axis=0) - low) / resolution_m) + _MARGIN_CELLS).astype(int).tolist()
    if width * height > 100_000_000:
        raise ShapeError(f"the scans span {width * resolution_m:.0f} x {height * resolution_m:.0f} m: too much")
    hits, passes = np.zeros((height, width), np.int32), np.zeros((height, width), np.int32)
    for scan in placed:
        count_rays((scan.laser - low) / resolution_m, (scan.ends - low) / resolution_m, hits, passes)
    return OccupancyGrid(_judge(hits, passes, min_hits, min_share), resolution_m, Pose2(float(low[0]), float(low[1])))


def _judge(hits: Int32s, passes: Int32s, min_hits: int, min_share: float) -> npt.NDArray[np.int8]:
    cells = np.full(hits.shape, UNKNOWN, np.int8)
    cells[(passes > 0) | (hits > 0)] = FREE
    cells[(hits > 0) & (hits < min_hits) & (passes == 0)] = UNKNOWN  # seen once, and never seen through
    cells[(hits >= min_hits) & (hits >= min_share * (hits + passes))] = OCCUPIED
    return cells


@kernel
def count_rays(start: Floats, ends: Floats, hits: Int32s, passes: Int32s) -> None:
    """Count for each cell the rays that end in it, and those that pass through it (Amanatides & Woo 1987).

    Parameters
    ----------
    start : (2,) float64
        Where the rays begin, in cells.
    ends : (N, 2) float64
        Where they end, in cells; all inside the arrays.
    hits, passes : (H, W) int32
        Counts, added to.
    """
    for n in range(ends.shape[0]):
        column, row = math.floor(start[0]), math.floor(start[1])
        last_column, last_row = math.floor(ends[n, 0]), math.floor(ends[n, 1])
        dx, dy = ends[n, 0] - start[0], ends[n, 1] - start[1]
        step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
        per_x = math.inf if dx == 0 else abs(1.0 / dx)
        per_y = math.inf if dy == 0 else abs(1.0 / dy)
        to_x = math.inf if dx == 0 else per_x * (column + 1 - start[0] if dx > 0 else start[0] - column)
        to_y = math.inf if dy == 0 else per_y * (row + 1 - start[1] if dy > 0 else start[1] - row)
        for _ in range(abs(last_column - column) + abs(last_row - row)):
            if column == last_column and row == last_row:
                break
            passes[row, column] += 1
            if to_x < to_y:
                to_x += per_x
                column += step_x
            else:
                to_y += per_y
                row += step_y
        hits[last_row, last_column] += 1
