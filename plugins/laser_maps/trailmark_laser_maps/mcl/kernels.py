"""Kernels of Monte Carlo localization: score poses on a field, refine them, ask how much of a scan they explain.

Poses are of base in grid axes, rays are the ends of a scan's returns in base axes.
"""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Bools, Float32s, Floats, Int32s
from trailmark.kernels import kernel

__all__ = [
    "beyond_walls",
    "count_agreeing",
    "distances_to_walls",
    "explained_shares",
    "normal_equations",
    "refine_poses",
    "score_poses",
]


@kernel
def score_poses(poses: Floats, rays: Floats, table: Float32s, is_free: Bools, cell_m: float, outside: float) -> Floats:
    """Return the sum of a table's values where the rays end, for every pose (N, 3), (N,).

    A ray that ends beyond the table counts `outside`; a pose that is not on a free cell as if a fifth of its rays did.
    """
    height, width = table.shape
    scores = np.empty(poses.shape[0])
    per_m = 1.0 / cell_m
    for n in range(poses.shape[0]):
        cos, sin = math.cos(poses[n, 2]) * per_m, math.sin(poses[n, 2]) * per_m
        x, y = poses[n, 0] * per_m, poses[n, 1] * per_m
        total = 0.0
        for ray in range(rays.shape[0]):
            u = x + cos * rays[ray, 0] - sin * rays[ray, 1]
            v = y + sin * rays[ray, 0] + cos * rays[ray, 1]
            if 0.0 <= u < width and 0.0 <= v < height:
                total += table[int(v), int(u)]
            else:
                total += outside
        if not (0.0 <= x < width and 0.0 <= y < height and is_free[int(y), int(x)]):
            total += 0.2 * outside * rays.shape[0]
        scores[n] = total
    return scores


@kernel
def count_agreeing(poses: Floats, rays: Floats, distance_m: Float32s, cell_m: float, near_m: float) -> Int32s:
    """Return for each ray how many poses put its end within `near_m` of a wall, (B,)."""
    height, width = distance_m.shape
    counts = np.zeros(rays.shape[0], np.int32)
    for n in range(poses.shape[0]):
        cos, sin = math.cos(poses[n, 2]), math.sin(poses[n, 2])
        for ray in range(rays.shape[0]):
            u = (poses[n, 0] + cos * rays[ray, 0] - sin * rays[ray, 1]) / cell_m
            v = (poses[n, 1] + sin * rays[ray, 0] + cos * rays[ray, 1]) / cell_m
            if 0.0 <= u < width and 0.0 <= v < height and distance_m[int(v), int(u)] < near_m:
                counts[ray] += 1
    return counts


@kernel
def explained_shares(
    poses: Floats, rays: Floats, laser: Floats, distance_m: Float32s, cell_m: float, near_m: float
) -> Floats:
    """Return the share of rays that a pose explains: the end near a wall, the way there through none, (N,).

    Parameters
    ----------
    poses : (N, 3) float64
        Of base [m, m, rad].
    rays : (B, 2) float64
        Ends of rays in base axes [m].
    laser : (2,) float64
        Where they begin, in base axes [m].
    distance_m : (H, W) float32
        See `GridField`.
    cell_m, near_m : float
        Side of a cell; how near to a wall a ray ends [m].
    """
    height, width = distance_m.shape
    shares = np.empty(poses.shape[0])
    for n in range(poses.shape[0]):
        cos, sin = math.cos(poses[n, 2]), math.sin(poses[n, 2])
        x = poses[n, 0] + cos * laser[0] - sin * laser[1]
        y = poses[n, 1] + sin * laser[0] + cos * laser[1]
        explained = 0
        for ray in range(rays.shape[0]):
            dx = poses[n, 0] + cos * rays[ray, 0] - sin * rays[ray, 1] - x
            dy = poses[n, 1] + sin * rays[ray, 0] + cos * rays[ray, 1] - y
            u, v = (x + dx) / cell_m, (y + dy) / cell_m
            if not (0.0 <= u < width and 0.0 <= v < height) or distance_m[int(v), int(u)] > near_m:
                continue
            length = math.sqrt(dx * dx + dy * dy)
            gone, is_free = 0.0, True
            while is_free and gone < length - 2.0 * near_m:
                u, v = (x + dx * gone / length) / cell_m, (y + dy * gone / length) / cell_m
                if not (0.0 <= u < width and 0.0 <= v < height):
                    break
                clearance = distance_m[int(v), int(u)]
                is_free = clearance > 0.0
                gone += max(clearance - cell_m, 0.5 * cell_m)
            explained += is_free
        shares[n] = explained / max(rays.shape[0], 1)
    return shares


@kernel
def normal_equations(
    pose: Floats,
    rays: Floats,
    walls: Floats,
    normals: Floats,
    nearest_idx: Int32s,
    cell_m: float,
    gate_m: float,
    hessian: Floats,
    gradient: Floats,
) -> tuple[float, int]:
    """Accumulate the Gauss-Newton equations of ray ends to the lines of the nearest walls (Chen & Medioni 1992).

    The unknowns are (dx, dy, dtheta) about the pose's position, in grid axes. Ends farther than the gate from their
    wall say nothing, those beyond a third of it less (Huber).

    Returns
    -------
    squared : float
        Sum of squared distances [m^2].
    n_used : int
        Rays within the gate whose wall is a line.
    """
    hessian[:] = 0.0
    gradient[:] = 0.0
    height, width = nearest_idx.shape
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    squared, n_used, corner = 0.0, 0, gate_m / 3.0
    row = np.empty(3)
    for ray in range(rays.shape[0]):
        rx = cos * rays[ray, 0] - sin * rays[ray, 1]
        ry = sin * rays[ray, 0] + cos * rays[ray, 1]
        u, v = (pose[0] + rx) / cell_m, (pose[1] + ry) / cell_m
        if not (0.0 <= u < width and 0.0 <= v < height):
            continue
        wall = nearest_idx[int(v), int(u)]
        ex, ey = pose[0] + rx - walls[wall, 0], pose[1] + ry - walls[wall, 1]
        if ex * ex + ey * ey > gate_m * gate_m:
            continue
        row[0], row[1] = normals[wall, 0], normals[wall, 1]
        if row[0] == 0.0 and row[1] == 0.0:
            continue
        row[2] = row[1] * rx - row[0] * ry
        residual = row[0] * ex + row[1] * ey
        weight = 1.0 if abs(residual) <= corner else corner / abs(residual)
        squared += residual * residual
        n_used += 1
        for i in range(3):
            gradient[i] += weight * row[i] * residual
            for j in range(3):
                hessian[i, j] += weight * row[i] * row[j]
    return squared, n_used


@kernel
def beyond_walls(
    pose: Floats, rays: Floats, walls: Floats, normals: Floats, nearest_idx: Int32s, cell_m: float, gate_m: float
) -> Floats:
    """Return how far the ends of rays lie beyond the lines of their walls, NaN where there is none near, (R,) [m]."""
    beyond_m = np.full(rays.shape[0], math.nan)
    height, width = nearest_idx.shape
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    for ray in range(rays.shape[0]):
        rx = cos * rays[ray, 0] - sin * rays[ray, 1]
        ry = sin * rays[ray, 0] + cos * rays[ray, 1]
        u, v = (pose[0] + rx) / cell_m, (pose[1] + ry) / cell_m
        if not (0.0 <= u < width and 0.0 <= v < height):
            continue
        wall = nearest_idx[int(v), int(u)]
        ex, ey = pose[0] + rx - walls[wall, 0], pose[1] + ry - walls[wall, 1]
        nx, ny = normals[wall, 0], normals[wall, 1]
        if ex * ex + ey * ey > gate_m * gate_m or (nx == 0.0 and ny == 0.0):
            continue
        away = 1.0 if nx * rx + ny * ry >= 0.0 else -1.0  # normals are sign free
        beyond_m[ray] = away * (nx * ex + ny * ey)
    return beyond_m


@kernel
def distances_to_walls(
    pose: Floats, rays: Floats, walls: Floats, normals: Floats, nearest_idx: Int32s, cell_m: float, gate_m: float
) -> Floats:
    """Return how far the ends of rays are from their walls, NaN where none is within the gate, (R,) [m].

    From the line where a wall is one, else from its nearest cell.
    """
    distances_m = np.full(rays.shape[0], math.nan)
    height, width = nearest_idx.shape
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    for ray in range(rays.shape[0]):
        x = pose[0] + cos * rays[ray, 0] - sin * rays[ray, 1]
        y = pose[1] + sin * rays[ray, 0] + cos * rays[ray, 1]
        u, v = x / cell_m, y / cell_m
        if not (0.0 <= u < width and 0.0 <= v < height):
            continue
        wall = nearest_idx[int(v), int(u)]
        ex, ey = x - walls[wall, 0], y - walls[wall, 1]
        distance_m = math.sqrt(ex * ex + ey * ey)
        if distance_m > gate_m:
            continue
        nx, ny = normals[wall, 0], normals[wall, 1]
        is_line = nx != 0.0 or ny != 0.0
        distances_m[ray] = abs(nx * ex + ny * ey) if is_line else distance_m
    return distances_m


@kernel
def refine_poses(
    poses: Floats,
    rays: Floats,
    walls: Floats,
    normals: Floats,
    nearest_idx: Int32s,
    cell_m: float,
    gates_m: Floats,
) -> Floats:
    """Return poses after one damped Gauss-Newton step for each gate; a pose that no ray fits stays, (N, 3)."""
    refined = poses.copy()
    hessian, gradient = np.empty((3, 3)), np.empty(3)
    for n in range(poses.shape[0]):
        for gate in range(gates_m.shape[0]):
            _, n_used = normal_equations(
                refined[n], rays, walls, normals, nearest_idx, cell_m, gates_m[gate], hessian, gradient
            )
            if n_used < 6:
                break
            damping = 1e-3 * (hessian[0, 0] + hessian[1, 1])  # a corridor leaves one direction free: hold it
            step = _solve3(hessian, gradient, damping)
            refined[n, 0] -= step[0]
            refined[n, 1] -= step[1]
            refined[n, 2] -= step[2]
    return refined


@kernel
def _solve3(matrix: Floats, vector: Floats, damping: float) -> tuple[float, float, float]:
    """Return the solution of a symmetric positive system of three unknowns (Cholesky)."""
    l00 = math.sqrt(matrix[0, 0] + damping)
    l10, l20 = matrix[1, 0] / l00, matrix[2, 0] / l00
    l11 = math.sqrt(matrix[1, 1] + damping - l10 * l10)
    l21 = (matrix[2, 1] - l20 * l10) / l11
    l22 = math.sqrt(matrix[2, 2] + damping - l20 * l20 - l21 * l21)
    y0 = vector[0] / l00
    y1 = (vector[1] - l10 * y0) / l11
    x2 = (vector[2] - l20 * y0 - l21 * y1) / l22 / l22
    x1 = (y1 - l21 * x2) / l11
    return (y0 - l10 * x1 - l20 * x2) / l00, x1, x2
