"""Landmark finders behind one interface: a view in, regions out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from trailmark_kinect_landmarks.finders.areas import find_blobs, find_flats, find_mser
from trailmark_kinect_landmarks.finders.shapes import (
    find_edges,
    find_ellipses,
    find_hough_circles,
    find_lines,
    find_rectangles,
)
from trailmark_kinect_landmarks.finders.view import Region, WorkingImage

__all__ = ["FINDERS", "Finder", "Region", "WorkingImage", "find"]

Finder = Callable[[WorkingImage], list[Region]]

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


def find(view: WorkingImage, names: Iterable[str]) -> list[Region]:
    """Return what the named finders see, in their order."""
    return [region for name in names for region in FINDERS[name](view)]
