"""An occupancy grid: which cells of a plan are occupied, free or unknown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Bools, Floats
from trailmark.errors import ShapeError
from trailmark.frames.payloads import read_only
from trailmark.geometry import Pose2

__all__ = ["FREE", "OCCUPIED", "UNKNOWN", "OccupancyGrid"]

#: Values of cells as in ``nav_msgs/OccupancyGrid``; between free and occupied lies a probability in percent.
FREE, OCCUPIED, UNKNOWN = 0, 100, -1
_EVEN = 50
_MOST_CELLS = 100_000_000


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class OccupancyGrid:
    """Cells of a plan, the first row at the bottom.

    Attributes
    ----------
    cells : (H, W) int8
        0 free to 100 occupied, -1 unknown; ``cells[row, column]`` covers x from ``column * resolution_m`` and y from
        ``row * resolution_m`` in grid axes.
    resolution_m : float
        Side of a cell [m].
    pose_map_grid : Pose2
        Lower left corner of cell (0, 0) in the map, x along the rows.

    Raises
    ------
    ShapeError
        If there is no cell, too many, or the resolution is not positive.
    """

    cells: npt.NDArray[np.int8]
    resolution_m: float
    pose_map_grid: Pose2 = Pose2()

    def __post_init__(self) -> None:
        if self.cells.ndim != 2 or not 0 < self.cells.size <= _MOST_CELLS or self.cells.dtype != np.int8:
            raise ShapeError(
                f"cells must be (H, W) int8, 1 to {_MOST_CELLS}, not {self.cells.shape} {self.cells.dtype}"
            )
        if not (np.isfinite(self.resolution_m) and self.resolution_m > 0):
            raise ShapeError(f"the resolution must be positive, not {self.resolution_m}")
        object.__setattr__(self, "cells", read_only(self.cells))

    def __repr__(self) -> str:
        height, width = self.cells.shape
        return (
            f"OccupancyGrid({width * self.resolution_m:.1f} x {height * self.resolution_m:.1f} m, "
            f"{self.free_m2:.0f} m2 free)"
        )

    @property
    def is_occupied(self) -> Bools:
        """Cells that are more likely occupied than not, (H, W)."""
        return np.asarray(self.cells >= _EVEN)

    @property
    def is_free(self) -> Bools:
        """Cells that are known to be more likely free than not, (H, W)."""
        return np.asarray((self.cells >= FREE) & ~self.is_occupied)

    @property
    def free_m2(self) -> float:
        """Area of the free cells [m^2]."""
        return float(self.is_free.sum()) * self.resolution_m**2

    def centres(self, chosen: Bools) -> Floats:
        """Return the middles of chosen cells in grid axes, (N, 2) [m]."""
        rows, columns = np.nonzero(chosen)
        return np.asarray((np.stack([columns, rows], axis=1) + 0.5) * self.resolution_m, np.float64)
