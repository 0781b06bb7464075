"""Walls in scans: the line through each point and its neighbours."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry.walls import main_axes

__all__ = ["scan_normals"]

_REACH = 4
_LINE_RATIO = 0.05


def scan_normals(points: Floats) -> Floats:
    """Return the unit normal of the wall through each point of a scan, zero where its neighbours are no line.

    Parameters
    ----------
    points : (N, 2) float64
        In the order of the rays [m].

    Returns
    -------
    (N, 2) float64
        Sign free.
    """
    count = len(points)
    if count < 3:
        return np.zeros((count, 2))
    window = np.arange(count)[:, np.newaxis] + np.arange(-_REACH, _REACH + 1)
    is_inside = (window >= 0) & (window < count)
    window = np.clip(window, 0, count - 1)
    near_m = np.maximum(0.1, 6.0 * _spacing(points))
    offsets = points[window] - points[:, np.newaxis]
    is_near = is_inside & (np.hypot(offsets[:, :, 0], offsets[:, :, 1]) < near_m[:, np.newaxis])
    n_near = is_near.sum(axis=1)
    share = is_near / n_near[:, np.newaxis]
    offsets = offsets - (share[:, :, np.newaxis] * offsets).sum(axis=1, keepdims=True)
    xx, yy = ((share * offsets[:, :, axis] ** 2).sum(axis=1) for axis in (0, 1))
    xy = (share * offsets[:, :, 0] * offsets[:, :, 1]).sum(axis=1)
    normals, thin, long = main_axes(xx, yy, xy)
    is_line = (n_near >= 4) & (thin < _LINE_RATIO * long)
    return np.where(is_line[:, np.newaxis], normals, 0.0)


def _spacing(points: Floats) -> Floats:
    """Return the distance of each point to its nearer neighbour in the scan, (N,) [m]."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    return np.asarray(np.minimum(np.append(steps, np.inf), np.append(np.inf, steps)))
