"""Points on walls: lines through neighbouring points, and the equations of matching points to such lines.

Iterative closest points with the point-to-line error (Chen & Medioni 1992; Censi 2008): whoever has found the wall
point nearest to each point gets the equations of the small motion that lays one onto the other, and what they do not
tell. Import it from modules that hold kernels: numba takes its time.
"""

from __future__ import annotations

import numpy as np

from trailmark.arrays import AnyArray, Bools, Floats
from trailmark.kernels import inlined_kernel, kernel

__all__ = [
    "add_line",
    "limited_information",
    "line_equations",
    "main_axes",
    "measured_directions",
    "measured_information",
    "measured_step",
    "move_to_lines",
]


#: Normals are uncertain by some 6 degrees; what a plain wall seems to say along itself is that.
NORMAL_NOISE = 0.01


@inlined_kernel
def add_line(hessian: AnyArray, gradient: AnyArray, jacobian: AnyArray, residual: float, corner: float) -> None:
    """Add a residual with its Jacobian (3,) to Gauss-Newton's equations, Huber-weighted from `corner` on.

    Parameters
    ----------
    hessian : (3, 3) float64
        Sum of weighted outer products; changed in place.
    gradient : (3,) float64
        Sum of weighted residuals times Jacobians; changed in place.
    jacobian : (3,) float64
        Derivative of the residual by (x, y, theta).
    residual : float
        Of one point, along the wall's normal [m].
    corner : float
        Residuals beyond it are weighted by its size over theirs (Huber) [m].
    """
    weight = 1.0 if abs(residual) <= corner else corner / abs(residual)
    for a in range(3):
        gradient[a] += weight * jacobian[a] * residual
        for b in range(3):
            hessian[a, b] += weight * jacobian[a] * jacobian[b]


@kernel
def line_equations(
    arms: AnyArray, offsets: AnyArray, normals: AnyArray, corner: float, hessian: AnyArray, gradient: AnyArray
) -> tuple[float, int]:
    """Fill Gauss-Newton's equations of points and the wall points they belong to.

    The unknown is a small motion (dx, dy, dtheta) in the axes of the points about the position of the pose.

    Parameters
    ----------
    arms : (N, 2) float64
        Points as seen from the position of the pose [m].
    offsets : (N, 2) float64
        Points less their wall points [m].
    normals : (N, 2) float64
        Unit normals of the walls there; zero: no line, which says nothing.
    corner : float
        Residual from which on weights fall [m].
    hessian, gradient : (3, 3) and (3,) float64
        Are written.

    Returns
    -------
    squared : float
        Sum of squared residuals [m^2].
    n_lines : int
        Points that say something.
    """
    hessian[:] = 0.0
    gradient[:] = 0.0
    squared, n_lines = 0.0, 0
    jacobian = np.empty(3)
    for n in range(arms.shape[0]):
        nx, ny = normals[n, 0], normals[n, 1]
        if nx == 0.0 and ny == 0.0:
            continue
        residual = nx * offsets[n, 0] + ny * offsets[n, 1]
        jacobian[0], jacobian[1], jacobian[2] = nx, ny, ny * arms[n, 0] - nx * arms[n, 1]
        squared += residual * residual
        n_lines += 1
        add_line(hessian, gradient, jacobian, residual, corner)
    return squared, n_lines


def main_axes(xx: Floats, yy: Floats, xy: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the principal axes of scatters of points: unit normals of the long axes, and both variances.

    Parameters
    ----------
    xx, yy, xy : (N,) float64
        Variances and covariance of the points of each neighbourhood [m^2].

    Returns
    -------
    normals : (N, 2) float64
        Across the long axis, sign free.
    thin, long : (N,) float64
        Variance across and along it [m^2].
    """
    along = 0.5 * np.arctan2(2.0 * xy, xx - yy)  # direction of the large axis of the scatter
    normals = np.stack([-np.sin(along), np.cos(along)], axis=1)
    spread = np.hypot(xx - yy, 2.0 * xy)
    return normals, (xx + yy - spread) / 2.0, (xx + yy + spread) / 2.0


def move_to_lines(
    points: Floats, weights: Floats, *, radius_m: float, n_neighbours: int, thin_ratio: float
) -> tuple[Floats, Floats]:
    """Return points moved onto the lines through their neighbours, and those lines' normals.

    Parameters
    ----------
    points : (N, 2) float64
        Points on walls [m].
    weights : (N,) float64
        How much each counts in the lines of its neighbours.
    radius_m : float
        Neighbours are nearer than this [m].
    n_neighbours : int
        How many are taken at the most, the point itself among them.
    thin_ratio : float
        A neighbourhood is a line where its variance across is less than this share of the one along it.

    Returns
    -------
    points : (N, 2) float64
        Moved along the normals; as they were where there is no line [m].
    normals : (N, 2) float64
        Of length one, sign free; zero where there is no line.
    """
    from scipy.spatial import cKDTree

    k = min(n_neighbours, len(points))
    distances, idx = cKDTree(points).query(points, k=k, distance_upper_bound=radius_m)
    is_near = np.isfinite(np.reshape(distances, (len(points), k)))
    idx = np.where(is_near, np.reshape(idx, (len(points), k)), 0)
    share = is_near * weights[idx]
    share = share / np.maximum(share.sum(axis=1, keepdims=True), 1e-12)
    centre = (points[idx] * share[:, :, None]).sum(axis=1)
    offsets = points[idx] - centre[:, None, :]
    xx, yy = ((share * offsets[:, :, axis] ** 2).sum(axis=1) for axis in (0, 1))
    xy = (share * offsets[:, :, 0] * offsets[:, :, 1]).sum(axis=1)
    normals, thin, long = main_axes(xx, yy, xy)
    is_line = (is_near.sum(axis=1) >= 3) & (thin < thin_ratio * np.maximum(long, 1e-12))
    normals = np.where(is_line[:, None], normals, 0.0)
    return points + normals * ((centre - points) * normals).sum(axis=1, keepdims=True), normals


def measured_directions(hessian: Floats, n_lines: int) -> tuple[Floats, Floats, Bools]:
    """Return eigenvalues (3,), eigenvectors (3, 3) and which of them walls measure: a corridor leaves one free."""
    values, vectors = np.linalg.eigh(hessian)
    return values, vectors, values > NORMAL_NOISE * n_lines


def measured_step(hessian: Floats, gradient: Floats, n_lines: int) -> Floats:
    """Return Gauss-Newton's step (3,) in the directions that walls measure; the others are held."""
    values, vectors, is_told = measured_directions(hessian, n_lines)
    shares = np.where(is_told, (vectors.T @ gradient) / np.where(is_told, values, 1.0), 0.0)
    return np.asarray(vectors @ shares)


def measured_information(hessian: Floats, n_lines: int) -> Floats:
    """Return the normal matrix without what noise of the normals puts into it; nothing where that is all there is."""
    noise = NORMAL_NOISE * n_lines
    values, vectors = np.linalg.eigh(hessian - np.diag([1.0, 1.0, 0.0]) * noise)
    return np.asarray((vectors * np.where(values > noise, values, 0.0)) @ vectors.T)


def limited_information(information: Floats, sigma: tuple[float, float]) -> Floats:
    """Return the information with a covariance added; directions may be unmeasured.

    Parameters
    ----------
    information : (3, 3) float64
        Of (x, y, theta).
    sigma : (float, float)
        What nothing is better than: position [m] and heading [rad].
    """
    floor = np.diag([sigma[0] ** 2, sigma[0] ** 2, sigma[1] ** 2])
    limited = information @ np.linalg.inv(np.eye(3) + floor @ information)
    return np.asarray((limited + limited.T) / 2.0)
