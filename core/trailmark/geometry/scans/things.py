"""Small things in a scan: whoever walks by is one, and a few of them are no proof of a motion."""

from __future__ import annotations

import numpy as np
from scipy.sparse.csgraph import connected_components

from trailmark.arrays import Bools, Floats

__all__ = ["few_small_things"]

#: What is as wide as this is a wall, and walls stay where they are [m].
_WIDE_M = 1.0
#: Points belong to one thing that are nearer than this, and so much more with each metre from the laser [m].
_LINK_M, _LINK_SHARE = 0.3, 0.03
#: A line counts along a direction from which its normal is less than 66 degrees away.
_FACING = 0.4
#: Small things that say the same are believed only if so many remain without the strongest, which may all walk.
_STRONGEST, _REMAIN = 4, 3


def few_small_things(points: Floats, normals: Floats, eye: Floats) -> Bools:
    """Return which points must not tell a motion: they are on small things, of which there are only a few.

    Each direction is looked at for itself: in a corridor, everything that faces along it. What is at least 1 m wide
    there counts. Of smaller things, the four strongest do not, and none of them if fewer than three would remain.

    Parameters
    ----------
    points : (N, 2) float64
        Ends of rays [m].
    normals : (N, 2) float64
        Unit normals of the lines that they were matched to, sign free; zero: none.
    eye : (2,) float64
        Where they are seen from [m].

    Returns
    -------
    (N,) bool
    """
    _, directions = np.linalg.eigh(normals.T @ normals)
    is_few = np.zeros(len(points), bool)
    for direction in directions.T:
        squared = np.square(normals @ direction)
        facing = np.flatnonzero(squared > _FACING**2)
        if len(facing):
            is_few[facing] |= _are_few(points[facing], squared[facing], eye)
    return is_few


def _are_few(points: Floats, strengths: Floats, eye: Floats) -> Bools:
    """Return which points are on the small things that do not count, given all that face one way."""
    labels = _things(points, eye)
    n_things = int(labels.max()) + 1
    lowest, highest = np.full((n_things, 2), np.inf), np.full((n_things, 2), -np.inf)
    np.minimum.at(lowest, labels, points)
    np.maximum.at(highest, labels, points)
    small = np.flatnonzero(np.hypot(*(highest - lowest).T) < _WIDE_M)
    if len(small) >= _STRONGEST + _REMAIN:
        small = small[np.argsort(-np.bincount(labels, strengths)[small])[:_STRONGEST]]
    return np.asarray(np.isin(labels, small))


def _things(points: Floats, eye: Floats) -> np.ndarray:
    """Return the number of the thing that each point is on, (N,): points with no gap between them."""
    reach = _LINK_M + _LINK_SHARE * np.hypot(*(points - eye).T)
    gaps = np.hypot(*(points[:, np.newaxis] - points[np.newaxis]).transpose(2, 0, 1))
    return np.asarray(connected_components(gaps < np.minimum(reach[:, np.newaxis], reach), directed=False)[1])
