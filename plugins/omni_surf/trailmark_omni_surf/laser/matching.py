"""Match a scan to a map: many start poses, the best of them refined point to line, the best fit wins."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from trailmark.errors import ShapeError
from trailmark.geometry import Pose2
from trailmark.geometry.walls import limited_information
from trailmark_omni_surf.laser.kernels import cheapest_starts, normal_equations, refine, score_starts
from trailmark_omni_surf.laser.scan_map import ScanMap, steps

__all__ = [
    "COARSE_GATES_M",
    "FINE_GATES_M",
    "FIT_GATE_M",
    "MAP_SIGMA",
    "ScanMatch",
    "SearchWindow",
    "best_fit",
    "is_elsewhere",
    "match_scan",
    "refine_all",
    "refined_starts",
]

# The gate shrinks so that the first steps pull in from afar and the last are not bent by what does not belong.
COARSE_GATES_M = np.array([0.5])
FINE_GATES_M = np.array([0.25, 0.12])
FIT_GATE_M = 0.10  # a point this near to the map fits it
_ITERATIONS = 5
#: What no match can be better than, because the map itself is not: position [m] and heading [rad].
MAP_SIGMA = (0.01, math.radians(0.25))


@dataclass(frozen=True, slots=True)
class SearchWindow:
    """Where to look around the guess.

    Attributes
    ----------
    span_m, step_m : float
        Start poses in x and y [m].
    span_rad, step_rad : float
        Start headings [rad].
    n_coarse, n_fine : int
        How many of the best starts are refined coarsely; how many of those to the end.
    thin : int
        Starts are scored and refined coarsely on every `thin`-th point.
    """

    span_m: float = 0.8
    step_m: float = 0.2
    span_rad: float = math.radians(12.0)
    step_rad: float = math.radians(4.0)
    n_coarse: int = 12
    n_fine: int = 4
    thin: int = 4

    def offsets(self) -> npt.NDArray[np.float64]:
        """Return the start poses relative to the guess, (S, 3) [m, m, rad], which cannot be written to."""
        return _offsets(self)


@cache  # a localizer asks with each scan
def _offsets(window: SearchWindow) -> npt.NDArray[np.float64]:
    xy, theta = steps(window.span_m, window.step_m), steps(window.span_rad, window.step_rad)
    grid = np.meshgrid(xy, xy, theta, indexing="ij")
    offsets = np.stack([axis.ravel() for axis in grid], axis=1)
    offsets.flags.writeable = False
    return offsets


@dataclass(frozen=True, slots=True, eq=False)
class ScanMatch:
    """How a scan fits a map.

    Attributes
    ----------
    pose_map_base : Pose2
        Best pose.
    information : (3, 3) float64
        Of (x, y, theta) in map axes; a corridor leaves none along itself.
    inlier_share : float
        Share of the points that lie within 0.1 m of the map.
    residual_m : float
        Root mean square residual of those [m].
    cost_m : float
        Mean distance of all points to the map, each truncated at the map's reach [m].
    runner_up_cost_m : float
        Cost of the best fit elsewhere (0.3 m or 10 deg away); ``inf`` when there is none [m].
    """

    pose_map_base: Pose2
    information: npt.NDArray[np.float64]
    inlier_share: float
    residual_m: float
    cost_m: float
    runner_up_cost_m: float


def match_scan(
    scan_map: ScanMap,
    points_base: npt.NDArray[np.float64],
    guess: Pose2,
    window: SearchWindow | None = None,
    *,
    to_line: bool = True,
    sigma_m: float = 0.02,
    correlation: float = 10.0,
    map_sigma: tuple[float, float] = MAP_SIGMA,
) -> ScanMatch:
    """Return the best fit of a scan to a map near a guess.

    Iterative closest points (Besl & McKay 1992) with the point-to-line error, from many starts: a single start
    falls into a neighbouring minimum in half the cases from 0.6 m and 10 deg.

    Parameters
    ----------
    scan_map : ScanMap
        The taught place.
    points_base : (N, 2) float64
        Points of the scan in base axes [m].
    guess : Pose2
        ``pose_map_base`` where the search is centred.
    window : SearchWindow, optional
        How far around it.
    to_line : bool
        False for the point-to-point error of the original.
    sigma_m, correlation : float
        Standard deviation of a residual [m], and how many neighbouring points share one error: together they
        scale the information.
    map_sigma : (float, float)
        What no match can be better than, because the map itself is not: position [m] and heading [rad].

    Raises
    ------
    ShapeError
        If the scan has fewer than 10 points, or not the shape (N, 2).
    """
    if points_base.ndim != 2 or points_base.shape[1] != 2 or len(points_base) < 10:
        raise ShapeError(f"a scan to be matched has at least 10 points of shape (N, 2), not {points_base.shape}")
    window = window or SearchWindow()
    points = np.ascontiguousarray(points_base, dtype=np.float64)
    starts = window.offsets() + guess.array()
    poses, costs = _refine_starts(scan_map, points, starts, window, to_line)
    return best_fit(
        scan_map, points, (poses, costs), to_line=to_line, noise=(sigma_m, correlation), map_sigma=map_sigma
    )


def best_fit(
    scan_map: ScanMap,
    points: npt.NDArray[np.float64],
    refined: tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]],
    *,
    to_line: bool = True,
    noise: tuple[float, float] = (0.02, 10.0),
    map_sigma: tuple[float, float] = MAP_SIGMA,
) -> ScanMatch:
    """Return the best of some refined poses (K, 3), whose costs (K,) [m] are known, and how it fits.

    `noise` and `map_sigma` are those of `match_scan`.
    """
    poses, costs = refined
    sigma_m, correlation = noise
    best = int(np.argmin(costs))
    elsewhere = is_elsewhere(poses, poses[best])
    runner_up = float(costs[elsewhere].min()) if elsewhere.any() else math.inf
    hessian, gradient = np.empty((3, 3)), np.empty(3)
    squared, n_fit = normal_equations(
        points, poses[best], scan_map.points, scan_map.normals, scan_map.origin, scan_map.cell_m,
        scan_map.nearest_idx, FIT_GATE_M, to_line, hessian, gradient,
    )  # fmt: skip
    residual_m = math.sqrt(squared / max(n_fit, 1))
    variance = correlation * max(sigma_m, residual_m) ** 2
    information = limited_information(hessian / variance, map_sigma)
    return ScanMatch(
        Pose2.from_array(poses[best]), information, n_fit / len(points), residual_m, float(costs[best]), runner_up
    )


def _refine_starts(
    scan_map: ScanMap,
    points: npt.NDArray[np.float64],
    starts: npt.NDArray[np.float64],
    window: SearchWindow,
    to_line: bool,
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Score all starts, refine the best, and return those poses with their costs."""
    raster = (scan_map.origin, scan_map.cell_m, scan_map.distance_m, scan_map.reach_m)
    thinned = np.ascontiguousarray(points[:: window.thin]) if len(points) >= 40 * window.thin else points
    coarse = starts[cheapest_starts(thinned, starts, *raster, window.n_coarse)]
    coarse = refine_all(scan_map, thinned, coarse, COARSE_GATES_M, to_line)
    fine = coarse[cheapest_starts(points, coarse, *raster, window.n_fine)]
    fine = refine_all(scan_map, points, fine, FINE_GATES_M, to_line)
    return fine, score_starts(points, fine, *raster)


def refined_starts(
    scan_map: ScanMap, points: npt.NDArray[np.float64], guess: Pose2, window: SearchWindow
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the best poses of a window, refined point to line, (K, 3), and their costs, (K,) [m]."""
    return _refine_starts(scan_map, points, window.offsets() + guess.array(), window, True)


def refine_all(
    scan_map: ScanMap,
    points: npt.NDArray[np.float64],
    poses: npt.NDArray[np.float64],
    gates_m: npt.NDArray[np.float64],
    to_line: bool,
) -> npt.NDArray[np.float64]:
    """Return the poses (K, 3) after a few steps towards the map with each of the gates."""
    refined = refine(
        points, poses, scan_map.points, scan_map.normals, scan_map.origin, scan_map.cell_m,
        scan_map.nearest_idx, gates_m, _ITERATIONS, to_line,
    )  # fmt: skip
    return np.asarray(refined)


def is_elsewhere(
    poses: npt.NDArray[np.float64],
    best: npt.NDArray[np.float64],
    apart: tuple[float, float] = (0.3, math.radians(10.0)),
) -> npt.NDArray[np.bool_]:
    """Return which poses (K, 3) are farther than that from one of them [m, rad]."""
    offset = np.hypot(poses[:, 0] - best[0], poses[:, 1] - best[1])
    turn = np.abs(np.angle(np.exp(1j * (poses[:, 2] - best[2]))))
    return np.asarray((offset > apart[0]) | (turn > apart[1]))
