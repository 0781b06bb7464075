"""Landmark finders behind one interface: a view in, regions out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from trailmark_kinect_landmarks.finders.areas import find_blobs, find_flats, find_mser
from trailmark_kinect_landmarks.finders.shapes import (
    find_edges,
    find_ellipses,
    find_hough_circles,
    find_lines,
    find_rectangles,
)
from trailmark_kinect_landmarks.finders.view import Region, Regions, WorkingImage

__all__ = ["FINDERS", "Finder", "Region", "Regions", "WorkingImage", "find"]

Finder = Callable[[WorkingImage], Regions]

#: All finders by the name a config gives them.
FINDERS: Mapping[str, Finder] = {
    "blobs": find_blobs,
    "rectangles": find_rectangles,
    "edges": find_edges,
    "ellipses": find_ellipses,
    "lines": find_lines,
    "flats": find_flats,
    "mser": find_mser,
    "hough_circles": find_hough_circles,
}


def find(view: WorkingImage, names: Iterable[str]) -> Regions:
    """Return what the named finders see, in their order."""
    found = [FINDERS[name](view) for name in names]
    boxes = [np.empty((0, 4)), *(regions.boxes for regions in found)]
    return Regions([kind for regions in found for kind in regions.kinds], np.concatenate(boxes))
