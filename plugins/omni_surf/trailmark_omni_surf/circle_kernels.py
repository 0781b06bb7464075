"""How much of the rim of many circles is seen: the search for the image circle judges more than a thousand of them."""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.kernels import kernel

__all__ = ["rim_coverages"]


@kernel
def rim_coverages(
    circles: AnyArray,
    points: AnyArray,
    directions: AnyArray,
    width: int,
    height: int,
    tolerance_px: float,
    aligned: float,
    n_sectors: int,
) -> AnyArray:
    """Return the share of each rim that is seen as an edge, of what lies inside the picture, (C,).

    Parameters
    ----------
    circles : (C, 3) float64
        Centre (u, v) and radius [px].
    points, directions : (N, 2) float64
        Edge pixels, and their gradient directions as unit vectors.
    width, height : int
        Of the picture [px]; a rim of which less than half lies inside counts as not seen.
    tolerance_px : float
        How far an edge may lie from the rim [px].
    aligned : float
        Cosine of the largest angle between gradient and radius.
    n_sectors : int
        Into how many sectors a rim is divided.
    """
    coverages = np.zeros(circles.shape[0])
    visible, is_seen = np.empty(n_sectors, np.bool_), np.empty(n_sectors, np.bool_)
    sector_rad = 2.0 * math.pi / n_sectors
    for c in range(circles.shape[0]):
        u, v, radius = circles[c, 0], circles[c, 1], circles[c, 2]
        n_visible = 0
        for s in range(n_sectors):
            angle = (s + 0.5) * sector_rad - math.pi
            rim_u, rim_v = u + radius * math.cos(angle), v + radius * math.sin(angle)
            visible[s] = rim_u > 3.0 and rim_v > 3.0 and rim_u < width - 4.0 and rim_v < height - 4.0
            is_seen[s] = False
            n_visible += visible[s]
        if 2 * n_visible < n_sectors:
            continue
        low, high = max(radius - tolerance_px, 0.0) ** 2, (radius + tolerance_px) ** 2
        for n in range(points.shape[0]):
            du, dv = points[n, 0] - u, points[n, 1] - v
            squared = du * du + dv * dv
            if squared <= low or squared >= high:
                continue
            along = du * directions[n, 0] + dv * directions[n, 1]
            if along * along > aligned * aligned * squared:
                is_seen[int((math.atan2(dv, du) + math.pi) / sector_rad) % n_sectors] = True
        n_seen = 0
        for s in range(n_sectors):
            n_seen += visible[s] and is_seen[s]
        coverages[c] = n_seen / n_visible
    return coverages
