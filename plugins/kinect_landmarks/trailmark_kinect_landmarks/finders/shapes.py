"""Finders of shapes, from the contours of the edges or by Hough's transformation."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark_kinect_landmarks.finders.view import Regions, WorkingImage

__all__ = ["find_edges", "find_ellipses", "find_hough_circles", "find_lines", "find_rectangles"]

_MIN_AREA_PX = 60.0
_MIN_SIDE_PX = 12.0
_CORNER_BOX_PX = 13.0
_RIGHT_ENOUGH = 0.45  # cosine of a rectangle's corner as the camera sees it: 63 to 117 deg
_ROUND = 0.85  # axes of an ellipse that is called a circle
_OFF_ELLIPSE = 0.08  # mean distance of the contour from the ellipse, in mean radii


def find_edges(view: WorkingImage) -> Regions:
    """Return corners where two long straight edges meet: of a door, a shelf, a change of colour."""
    polygons = [polygon.reshape(-1, 2) for polygon in view.polygons if len(polygon) >= 3]
    if not polygons:
        return view.regions("edge", ())
    corners = np.concatenate(polygons).astype(np.float64)  # all at once: there are hundreds
    n_corners = np.array([len(polygon) for polygon in polygons])
    last = np.cumsum(n_corners) - 1
    first = last - n_corners + 1
    previous, following = np.arange(len(corners)) - 1, np.arange(len(corners)) + 1
    previous[first], following[last] = last, first
    before, after = corners[previous] - corners, corners[following] - corners
    lengths = np.hypot(*before.T), np.hypot(*after.T)
    cosine = (before * after).sum(axis=1) / np.maximum(lengths[0] * lengths[1], 1e-9)
    sharp = (np.abs(cosine) < 0.8) & (np.minimum(*lengths) >= _MIN_SIDE_PX)
    return view.regions("edge", _boxes_around(corners[sharp]))


def find_rectangles(view: WorkingImage) -> Regions:
    """Return convex quadrangles with about right corners."""
    boxes = [cv2.boundingRect(polygon) for polygon in view.polygons if _is_rectangle(polygon)]
    return view.regions("rectangle", boxes)


def _is_rectangle(polygon: npt.NDArray[Any]) -> bool:
    if len(polygon) != 4 or cv2.contourArea(polygon) < _MIN_AREA_PX or not cv2.isContourConvex(polygon):
        return False
    corners = polygon.reshape(4, 2).astype(np.float64)
    sides = np.roll(corners, -1, axis=0) - corners
    unit = sides / np.linalg.norm(sides, axis=1)[:, None]
    return bool(np.abs((unit * np.roll(unit, 1, axis=0)).sum(axis=1)).max() < _RIGHT_ENOUGH)


def find_ellipses(view: WorkingImage) -> Regions:
    """Return closed contours that are ellipses, circles among them; costs nothing beyond the edges."""
    kinds, boxes = [], []
    for chain in view.contours:
        if cv2.contourArea(chain) < 0.6 * len(chain) ** 2 / (4.0 * math.pi):  # not round, or not closed
            continue
        (u, v), axes, angle_deg = cv2.fitEllipse(chain)
        if min(axes) < 6.0 or max(axes) > 0.5 * view.grey.shape[1] or _off_ellipse(chain, u, v, axes, angle_deg):
            continue
        kinds.append("circle" if min(axes) / max(axes) > _ROUND else "ellipse")
        boxes.append(cv2.boundingRect(chain))
    return view.regions(kinds, boxes)


def _off_ellipse(
    chain: npt.NDArray[Any], u: float, v: float, axes: tuple[float, float] | Any, angle_deg: float
) -> bool:
    cos, sin = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    from_centre = chain.reshape(-1, 2) - (u, v)
    across = (from_centre @ (cos, sin)) / (axes[0] / 2.0)
    along = (from_centre @ (-sin, cos)) / (axes[1] / 2.0)
    return float(np.abs(np.hypot(across, along) - 1.0).mean()) > _OFF_ELLIPSE


def find_hough_circles(view: WorkingImage) -> Regions:
    """Return circles by Hough's transformation, at half resolution: slow, and on real pictures mostly false."""
    small = cv2.medianBlur(view.half.grey, 5)
    circles = cv2.HoughCircles(
        small, cv2.HOUGH_GRADIENT, dp=1.5, minDist=12, param1=120, param2=40, minRadius=4, maxRadius=60
    )
    if circles is None:
        return view.regions("circle", ())
    u, v, radius = np.asarray(circles).reshape(-1, 3).T
    side = 4.0 * radius + 1.0
    return view.regions("circle", np.stack([2.0 * (u - radius) + 0.5, 2.0 * (v - radius) + 0.5, side, side], axis=1))


def find_lines(view: WorkingImage) -> Regions:
    """Return straight lines by Hough's transformation, at half resolution: a frame around each of both ends."""
    lines = cv2.HoughLinesP(view.half.edges, 1.0, math.pi / 90.0, threshold=30, minLineLength=25, maxLineGap=3)
    if lines is None:
        return view.regions("line", ())
    return view.regions("line", _boxes_around(2.0 * np.asarray(lines, dtype=np.float64).reshape(-1, 2) + 0.5))


def _boxes_around(uv: Floats) -> Floats:
    """Return frames of one size around pixels, (N, 4)."""
    return np.column_stack([uv - (_CORNER_BOX_PX - 1.0) / 2.0, np.full((len(uv), 2), _CORNER_BOX_PX)])
