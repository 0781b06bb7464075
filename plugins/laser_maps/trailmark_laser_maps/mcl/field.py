"""What a grid says of a scan: how far each place is from the nearest wall, made once when a map is loaded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import distance_transform_edt

from trailmark.arrays import Bools, Float32s, Floats, Int32s
from trailmark.errors import ShapeError
from trailmark.geometry import Pose2
from trailmark.geometry.walls import move_to_lines
from trailmark_laser_maps.grid import OccupancyGrid

__all__ = ["GridField"]

#: Farther from a wall than this all places are alike [m].
REACH_M = 1.0
#: A return is of nothing in the map (people, things moved, glass) this often.
_STRAY = 0.1
_NARROW_M, _WIDE_M = 0.08, 0.25
_NEIGHBOURS, _NEIGHBOUR_CELLS, _LINE_RATIO = 16, 4.5, 0.12


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class GridField:
    """A grid prepared for scans; all coordinates are grid axes: metres from the lower left corner.

    Attributes
    ----------
    distance_m : (H, W) float32
        From the middle of a cell to that of the nearest occupied one, at most `REACH_M` [m].
    nearest_idx : (H, W) int32
        Index of that one in `walls`.
    walls, normals : (N, 2) float64
        Occupied cells, moved onto the line through their neighbours, and its normal; zero where there is no line [m].
    narrow, wide : (H, W) float32
        Logarithm of the likelihood of a return in a cell, up to a constant: to follow a pose, and to find one.
    free_cells : (F, 2) int32
        Column and row of the cells where a robot may stand.
    is_free : (H, W) bool
        The same as a mask.
    cell_m : float
        Side of a cell [m].
    pose_map_grid : Pose2
        Of the grid.
    """

    distance_m: Float32s
    nearest_idx: Int32s
    walls: Floats
    normals: Floats
    narrow: Float32s
    wide: Float32s
    free_cells: Int32s
    is_free: Bools
    cell_m: float
    pose_map_grid: Pose2

    @classmethod
    def of(cls, grid: OccupancyGrid) -> GridField:
        """Return the field of a grid.

        Raises
        ------
        ShapeError
            If the grid has no occupied or no free cell.
        """
        is_occupied, is_free = grid.is_occupied, grid.is_free
        if not is_occupied.any() or not is_free.any():
            raise ShapeError("the map has no occupied or no free cell: nothing can be found on it")
        cells, nearest = distance_transform_edt(~is_occupied, return_indices=True)
        distance_m = np.minimum(cells * grid.resolution_m, REACH_M)
        number = np.cumsum(is_occupied.ravel()).reshape(is_occupied.shape) - 1
        walls, normals = _on_lines(grid.centres(is_occupied), grid.resolution_m)
        rows, columns = np.nonzero(is_free)
        return cls(
            distance_m.astype(np.float32),
            number[nearest[0], nearest[1]].astype(np.int32),
            walls,
            normals,
            _log_likelihood(distance_m, _NARROW_M),
            _log_likelihood(distance_m, _WIDE_M),
            np.stack([columns, rows], axis=1).astype(np.int32),
            is_free,
            grid.resolution_m,
            grid.pose_map_grid,
        )

    def draw_poses(self, count: int, rng: np.random.Generator) -> Floats:
        """Return poses all over the free cells, of any heading, (count, 3)."""
        cells = self.free_cells[rng.integers(len(self.free_cells), size=count)]
        poses = np.empty((count, 3))
        poses[:, :2] = (cells + rng.random((count, 2))) * self.cell_m
        poses[:, 2] = rng.uniform(-np.pi, np.pi, count)
        return poses


def _log_likelihood(distance_m: npt.NDArray[np.floating], sigma_m: float) -> Float32s:
    """Return the logarithm of a mixture of a wall's normal distribution and of strays (Thrun et al. 2005, Sec. 6.4)."""
    hit = np.exp(-0.5 * np.square(distance_m / sigma_m))
    return np.asarray(np.log((1.0 - _STRAY) * hit + _STRAY), np.float32)


def _on_lines(centres: Floats, cell_m: float) -> tuple[Floats, Floats]:
    """Return the middles of cells moved onto the lines through their neighbours, and those lines' normals.

    A wall that lies aslant over the grid is a staircase of cells; on the line through them it is where it was to a
    fraction of a cell.
    """
    radius_m = _NEIGHBOUR_CELLS * cell_m
    return move_to_lines(
        centres, np.ones(len(centres)), radius_m=radius_m, n_neighbours=_NEIGHBOURS, thin_ratio=_LINE_RATIO
    )
