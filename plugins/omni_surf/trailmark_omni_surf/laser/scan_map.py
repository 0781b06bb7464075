"""A map of scan points with a raster that answers "which map point is nearest" in one look-up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import ShapeError
from trailmark.geometry import Pose2
from trailmark.geometry.walls import move_to_lines
from trailmark_omni_surf.laser.kernels import stamp_nearest

__all__ = ["ScanMap"]


_LINE_RATIO = 0.15  # a neighbourhood this much thinner than long is a line
_MAX_CELLS = 60_000_000  # 5 cm cells of 380 x 380 m: beyond it a stray point has blown the map up


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ScanMap:
    """Points of a taught place, and a raster of the nearest one.

    Attributes
    ----------
    points : (N, 2) float64
        Map points [m].
    normals : (N, 2) float64
        Unit normals of the wall through each point, sign free; zero where the neighbourhood is no line.
    nearest_idx : (H, W) int32
        Index of the map point nearest to the centre of each cell; -1 farther than `reach_m` from all.
    distance_m : (H, W) float32
        Distance from the cell's centre to it, `reach_m` where there is none [m].
    origin : (2,) float64
        Lower left corner of the raster [m].
    cell_m, reach_m : float
        Size of a cell; radius around each point within which the raster answers [m].
    """

    points: Floats
    normals: Floats
    nearest_idx: npt.NDArray[np.int32]
    distance_m: npt.NDArray[np.float32]
    origin: Floats
    cell_m: float
    reach_m: float

    def __repr__(self) -> str:
        height, width = self.nearest_idx.shape
        return f"ScanMap({len(self.points)} points, {width * self.cell_m:.1f} x {height * self.cell_m:.1f} m)"

    @classmethod
    def from_scans(
        cls,
        scans: Sequence[Floats],
        poses_map_base: Sequence[Pose2],
        *,
        min_hits: int = 2,
        thin_m: float = 0.05,
        cell_m: float = 0.05,
        reach_m: float = 0.5,
    ) -> ScanMap:
        """Build the map of scans taken at known poses.

        Parameters
        ----------
        scans : sequence of (M, 2) float64
            Points of each scan in base axes [m].
        poses_map_base : sequence of Pose2
            Where each was taken.
        min_hits : int
            A place counts when this many scans saw it: what walked through is left out. With fewer scans than
            that, every place counts.
        thin_m : float
            Points in one cell of this size become their mean: it takes the smear out of a wall [m].
        cell_m, reach_m : float
            Raster, see the class.

        Raises
        ------
        ShapeError
            If there are no points, or they span more than the raster can hold.
        """
        if len(scans) != len(poses_map_base):
            raise ShapeError(f"{len(scans)} scans but {len(poses_map_base)} poses")
        placed = [pose @ scan for scan, pose in zip(scans, poses_map_base, strict=True) if len(scan)]
        if not placed:
            raise ShapeError("the scans hold no points, so there is no map to build")
        points, n_scans = _thin_cells(placed, thin_m, min_hits if len(placed) >= min_hits else 1)
        if len(points) == 0:
            raise ShapeError(f"no place was seen by {min_hits} scans; teach more slowly or lower min_hits")
        # Scans taken at poses a few centimetres wrong smear a wall over several cells. A scan would settle on its near
        # face; on the line through the middle it does not.
        on_walls = move_to_lines(points, n_scans, radius_m=3 * thin_m, n_neighbours=24, thin_ratio=_LINE_RATIO)
        return cls.from_points(*on_walls, cell_m=cell_m, reach_m=reach_m)

    @classmethod
    def from_points(cls, points: Floats, normals: Floats, *, cell_m: float = 0.05, reach_m: float = 0.5) -> ScanMap:
        """Build the map of points and normals already in map coordinates, both (N, 2) [m]."""
        if points.ndim != 2 or points.shape[1] != 2 or len(points) == 0 or not np.isfinite(points).all():
            raise ShapeError(f"map points must be (N, 2), finite and at least one, not {points.shape}")
        origin = points.min(axis=0) - reach_m - cell_m
        size = np.ceil((points.max(axis=0) + reach_m + cell_m - origin) / cell_m).astype(int)
        if int(size[0]) * int(size[1]) > _MAX_CELLS:
            raise ShapeError(
                f"the map spans {size[0] * cell_m:.0f} x {size[1] * cell_m:.0f} m: too much for {cell_m} m"
            )
        nearest_idx = np.full((size[1], size[0]), -1, dtype=np.int32)
        distance_m = np.full((size[1], size[0]), reach_m, dtype=np.float32)
        stamp_nearest(points, origin, cell_m, reach_m, nearest_idx, distance_m)
        return cls(points, normals, nearest_idx, distance_m, origin, cell_m, reach_m)


def _thin_cells(placed: Sequence[Floats], thin_m: float, min_hits: int) -> tuple[Floats, Floats]:
    """Return the mean point of every cell that at least `min_hits` scans saw, and how many saw it."""
    points = np.concatenate(placed)
    scan_idx = np.repeat(np.arange(len(placed)), [len(scan) for scan in placed])
    cells = np.floor(points / thin_m).astype(np.int64)
    keys = cells[:, 0] * (1 << 32) + cells[:, 1]
    unique, inverse = np.unique(keys, return_inverse=True)
    n_points = np.bincount(inverse)
    mean = np.stack([np.bincount(inverse, weights=points[:, axis]) / n_points for axis in (0, 1)], axis=1)
    n_scans = np.bincount(np.unique(inverse * len(placed) + scan_idx) // len(placed), minlength=len(unique))
    is_seen = n_scans >= min_hits
    return np.ascontiguousarray(mean[is_seen]), n_scans[is_seen].astype(np.float64)


def steps(span: float, step: float) -> npt.NDArray[np.float64]:
    """Return the offsets of a search: zero, and steps to both sides up to `span`."""
    n = math.ceil(span / step - 1e-9)
    return np.asarray(np.arange(-n, n + 1) * step, dtype=np.float64)
