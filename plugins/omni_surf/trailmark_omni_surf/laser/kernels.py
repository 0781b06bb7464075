"""Kernels of scan matching: rasterise, score start poses, refine one of them."""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.kernels import kernel

__all__ = ["cheapest_starts", "normal_equations", "refine", "score_starts", "stamp_nearest", "truncated_cost"]


@kernel
def stamp_nearest(
    points: AnyArray, origin: AnyArray, cell_m: float, reach_m: float, nearest_idx: AnyArray, distance_m: AnyArray
) -> None:
    """Write every point into the cells within its reach, where it is nearer than what stands there.

    Parameters
    ----------
    points : (N, 2) float64
        Points of the map [m].
    origin : (2,) float64
        Corner of the grid [m].
    cell_m : float
        Side of a cell [m].
    reach_m : float
        How far from a point cells are written [m].
    nearest_idx : (rows, columns) int
        Nearest point of each cell, -1 for none; changed in place.
    distance_m : (rows, columns) float64
        Its distance [m]; changed in place.
    """
    height, width = nearest_idx.shape
    reach_cells = math.ceil(reach_m / cell_m)
    for n in range(points.shape[0]):
        x = (points[n, 0] - origin[0]) / cell_m
        y = (points[n, 1] - origin[1]) / cell_m
        column, row = int(x), int(y)
        for v in range(max(0, row - reach_cells), min(height, row + reach_cells + 1)):
            dy = (v + 0.5 - y) * cell_m
            for u in range(max(0, column - reach_cells), min(width, column + reach_cells + 1)):
                dx = (u + 0.5 - x) * cell_m
                distance = math.sqrt(dx * dx + dy * dy)
                if distance < distance_m[v, u]:
                    distance_m[v, u] = distance
                    nearest_idx[v, u] = n


@kernel
def truncated_cost(
    points: AnyArray,
    x: float,
    y: float,
    theta: float,
    origin: AnyArray,
    cell_m: float,
    distance_m: AnyArray,
    reach_m: float,
) -> float:
    """Return the mean distance of the points to the map at a pose, each at most `reach_m` [m].

    Parameters
    ----------
    points : (N, 2) float64
        Points of the scan in base axes [m].
    x, y, theta : float
        Pose of base in the map [m, m, rad].
    origin : (2,) float64
        Corner of the grid [m].
    cell_m : float
        Side of a cell [m].
    distance_m : (rows, columns) float64
        Distance of each cell to the nearest point of the map [m].
    reach_m : float
        Larger distances count as this one [m].

    Returns
    -------
    float
        Mean distance [m].

    Notes
    -----
    `cheapest_starts` has the same loop, which it leaves early: what changes here changes there.
    """
    height, width = distance_m.shape
    cos, sin = math.cos(theta), math.sin(theta)
    total = 0.0
    for n in range(points.shape[0]):
        u = (x + cos * points[n, 0] - sin * points[n, 1] - origin[0]) / cell_m
        v = (y + sin * points[n, 0] + cos * points[n, 1] - origin[1]) / cell_m
        if 0.0 <= u < width and 0.0 <= v < height:
            total += distance_m[int(v), int(u)]
        else:
            total += reach_m
    return float(total / max(points.shape[0], 1))


@kernel
def score_starts(
    points: AnyArray, starts: AnyArray, origin: AnyArray, cell_m: float, distance_m: AnyArray, reach_m: float
) -> AnyArray:
    """Return the cost of every start pose (S, 3), (S,) [m].

    Parameters
    ----------
    points : (N, 2) float64
        Points of the scan in base axes [m].
    starts : (S, 3) float64
        Poses of base in the map [m, m, rad].
    origin : (2,) float64
        Corner of the grid [m].
    cell_m : float
        Side of a cell [m].
    distance_m : (rows, columns) float64
        Distance of each cell to the nearest point of the map [m].
    reach_m : float
        Larger distances count as this one [m].

    Returns
    -------
    (S,) float64
        See `truncated_cost` [m].
    """
    costs = np.empty(starts.shape[0])
    for s in range(starts.shape[0]):
        costs[s] = truncated_cost(points, starts[s, 0], starts[s, 1], starts[s, 2], origin, cell_m, distance_m, reach_m)
    return costs


@kernel
def cheapest_starts(
    points: AnyArray,
    starts: AnyArray,
    origin: AnyArray,
    cell_m: float,
    distance_m: AnyArray,
    reach_m: float,
    n_best: int,
) -> AnyArray:
    """Return the rows of the cheapest starts, the cheapest first, of equal ones the first: those of `score_starts`.

    A start is left as soon as its sum is beyond what the last of the best has in all: distances are never negative.
    For this it repeats the loop of `truncated_cost`; a test holds both to the same order.

    Parameters
    ----------
    points, starts, origin, cell_m, distance_m, reach_m
        As for `score_starts`.
    n_best : int
        How many are asked for.

    Returns
    -------
    (min(n_best, S),) int64
        Rows of `starts`.
    """
    n_points, n_kept = points.shape[0], min(n_best, starts.shape[0])
    height, width = distance_m.shape
    rows, totals = np.empty(n_kept, np.int64), np.full(n_kept, np.inf)
    origin_x, origin_y, last = origin[0], origin[1], n_kept - 1
    for s in range(starts.shape[0]):
        x, y, theta = starts[s]
        cos, sin = math.cos(theta), math.sin(theta)
        total, limit = 0.0, totals[last]
        for n in range(n_points):
            u = (x + cos * points[n, 0] - sin * points[n, 1] - origin_x) / cell_m
            v = (y + sin * points[n, 0] + cos * points[n, 1] - origin_y) / cell_m
            if 0.0 <= u < width and 0.0 <= v < height:
                total += distance_m[int(v), int(u)]
            else:
                total += reach_m
            if total >= limit:
                break
        if total >= limit:
            continue
        at = last
        while at > 0 and totals[at - 1] > total:
            totals[at], rows[at] = totals[at - 1], rows[at - 1]
            at -= 1
        totals[at], rows[at] = total, s
    return rows


@kernel
def normal_equations(
    points: AnyArray,
    pose: AnyArray,
    map_points: AnyArray,
    map_normals: AnyArray,
    origin: AnyArray,
    cell_m: float,
    nearest_idx: AnyArray,
    gate_m: float,
    to_line: bool,
    hessian: AnyArray,
    gradient: AnyArray,
) -> tuple[float, int]:
    """Accumulate the Gauss-Newton equations of the points within the gate, Huber-weighted at a third of it.

    The unknown is a small motion (dx, dy, dtheta) in map axes about the pose's position. Point to line, map points
    whose neighbourhood is no line say nothing; point to point, as Besl and McKay match, all count.

    Parameters
    ----------
    points : (N, 2) float64
        Points of the scan in base axes [m].
    pose : (3,) float64
        Base in the map [m, m, rad].
    map_points, map_normals : (K, 2) float64
        Points of the map [m] and their normals, (0, 0) where the neighbourhood is no line.
    origin : (2,) float64
        Corner of the grid [m].
    cell_m : float
        Side of a cell [m].
    nearest_idx : (rows, columns) int
        Nearest map point of each cell, -1 for none.
    gate_m : float
        Points farther from the map do not count [m].
    to_line : bool
        Point to line; False: point to point.
    hessian, gradient : (3, 3), (3,) float64
        Written in place.

    Returns
    -------
    squared : float
        Sum of squared residuals [m^2].
    n_used : int
        Points within the gate.
    """
    height, width = nearest_idx.shape
    x, y, cos, sin = pose[0], pose[1], math.cos(pose[2]), math.sin(pose[2])
    origin_x, origin_y = origin[0], origin[1]
    squared, n_used = 0.0, 0
    corner = gate_m / 3.0
    # twelve numbers in registers: as arrays they would be stored at each point
    g0 = g1 = g2 = h00 = h01 = h02 = h10 = h11 = h12 = h20 = h21 = h22 = 0.0
    for n in range(points.shape[0]):
        rx = cos * points[n, 0] - sin * points[n, 1]
        ry = sin * points[n, 0] + cos * points[n, 1]
        u = (x + rx - origin_x) / cell_m
        v = (y + ry - origin_y) / cell_m
        if not (0.0 <= u < width and 0.0 <= v < height):
            continue
        idx = nearest_idx[int(v), int(u)]
        if idx < 0:
            continue
        ex = x + rx - map_points[idx, 0]
        ey = y + ry - map_points[idx, 1]
        if ex * ex + ey * ey > gate_m * gate_m:
            continue
        n_used += 1
        nx, ny = map_normals[idx, 0], map_normals[idx, 1]
        if to_line and nx == 0.0 and ny == 0.0:  # no line: where it lies along the wall is chance, not measurement
            continue
        for axis in range(1 if to_line else 2):
            if not to_line:
                nx, ny = (1.0, 0.0) if axis == 0 else (0.0, 1.0)
            residual = nx * ex + ny * ey
            turn = ny * rx - nx * ry
            squared += residual * residual
            weight = 1.0 if abs(residual) <= corner else corner / abs(residual)  # Huber
            wx, wy, wt = weight * nx, weight * ny, weight * turn
            g0 += wx * residual
            g1 += wy * residual
            g2 += wt * residual
            h00 += wx * nx
            h01 += wx * ny
            h02 += wx * turn
            h10 += wy * nx
            h11 += wy * ny
            h12 += wy * turn
            h20 += wt * nx
            h21 += wt * ny
            h22 += wt * turn
    gradient[0], gradient[1], gradient[2] = g0, g1, g2
    hessian[0, 0], hessian[0, 1], hessian[0, 2] = h00, h01, h02
    hessian[1, 0], hessian[1, 1], hessian[1, 2] = h10, h11, h12
    hessian[2, 0], hessian[2, 1], hessian[2, 2] = h20, h21, h22
    return squared, n_used


@kernel
def refine(
    points: AnyArray,
    starts: AnyArray,
    map_points: AnyArray,
    map_normals: AnyArray,
    origin: AnyArray,
    cell_m: float,
    nearest_idx: AnyArray,
    gates_m: AnyArray,
    iterations: int,
    to_line: bool,
) -> AnyArray:
    """Return the poses (K, 3) after Gauss-Newton steps with each gate in turn; a start when nothing matches.

    Parameters
    ----------
    points : (N, 2) float64
        Points of the scan in base axes [m].
    starts : (K, 3) float64
        Base in the map [m, m, rad].
    map_points, map_normals : (M, 2) float64
        As for `normal_equations`.
    origin : (2,) float64
        Corner of the grid [m].
    cell_m : float
        Side of a cell [m].
    nearest_idx : (rows, columns) int
        Nearest map point of each cell, -1 for none.
    gates_m : (G,) float64
        One gate after the other [m].
    iterations : int
        Steps with each gate, at the most.
    to_line : bool
        Point to line; False: point to point.

    Returns
    -------
    (K, 3) float64
        Base in the map [m, m, rad].
    """
    poses = starts.copy()
    for k in range(poses.shape[0]):
        _refine_pose(
            points, poses[k], map_points, map_normals, origin, cell_m, nearest_idx, gates_m, iterations, to_line
        )
    return poses


@kernel
def _refine_pose(
    points: AnyArray,
    pose: AnyArray,
    map_points: AnyArray,
    map_normals: AnyArray,
    origin: AnyArray,
    cell_m: float,
    nearest_idx: AnyArray,
    gates_m: AnyArray,
    iterations: int,
    to_line: bool,
) -> None:
    """Take the steps of `refine` for one pose (3,), in place."""
    hessian, gradient = np.empty((3, 3)), np.empty(3)
    for gate in range(gates_m.shape[0]):
        for _ in range(iterations):
            _, n_used = normal_equations(
                points, pose, map_points, map_normals, origin, cell_m, nearest_idx, gates_m[gate], to_line,
                hessian, gradient,
            )  # fmt: skip
            if n_used < 6:
                return
            trace = hessian[0, 0] + hessian[1, 1] + hessian[2, 2]
            for a in range(3):  # a corridor leaves one direction free: hold it instead of dividing by nothing
                hessian[a, a] += 1e-4 * trace + 1e-9
            step = _solve3(hessian, gradient)
            pose[0] -= step[0]
            pose[1] -= step[1]
            pose[2] -= step[2]
            if abs(step[0]) + abs(step[1]) < 2e-4 and abs(step[2]) < 1e-4:
                break


@kernel
def _solve3(matrix: AnyArray, vector: AnyArray) -> tuple[float, float, float]:
    """Solve a symmetric positive definite system of three unknowns (Cholesky; LAPACK costs more than it saves)."""
    l00 = math.sqrt(matrix[0, 0])
    l10, l20 = matrix[1, 0] / l00, matrix[2, 0] / l00
    l11 = math.sqrt(matrix[1, 1] - l10 * l10)
    l21 = (matrix[2, 1] - l20 * l10) / l11
    l22 = math.sqrt(matrix[2, 2] - l20 * l20 - l21 * l21)
    y0 = vector[0] / l00
    y1 = (vector[1] - l10 * y0) / l11
    y2 = (vector[2] - l20 * y0 - l21 * y1) / l22
    x2 = y2 / l22
    x1 = (y1 - l21 * x2) / l11
    return (y0 - l10 * x1 - l20 * x2) / l00, x1, x2
