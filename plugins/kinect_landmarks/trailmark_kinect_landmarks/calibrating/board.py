"""The rectangle in a picture of depth and in the picture of colour beside it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.arrays import Bgr8, Floats, Grey8

__all__ = ["BoardView", "find_board"]


_MIN_SHARE, _MAX_SHARE = 0.01, 0.5  # of the picture's area
_STEP = 0.02  # of the depth: a larger step between neighbours is the edge of something
_MIN_FILL = 0.9  # of its convex hull
_OFF_PLANE = 0.02  # of the depth
_OVERLAP = 0.3  # of the two rectangles, both pictures laid over one another
_SEARCH_PX = 6  # the edge in colour is looked for so far to both sides
_N_PROFILES = 40


@dataclass(frozen=True, slots=True, eq=False)
class BoardView:
    """The rectangle in one pair of pictures.

    Attributes
    ----------
    colour_uv, depth_uv : (4, 2) float64
        Its corners, in the same order, clockwise from the upper left [px].
    depth_m : (4,) float64
        Depth of the corners, of the plane through all of it [m].
    """

    colour_uv: Floats
    depth_uv: Floats
    depth_m: Floats


def find_board(bgr: Bgr8, depth_m: npt.NDArray[np.float32]) -> BoardView | None:
    """Return the flat quadrangle that both pictures show whole, the nearest first; None where there is none."""
    grey = np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY), np.uint8)
    candidates = _in_colour(grey)
    for corners, z in _in_depth(depth_m):
        scale = np.array(bgr.shape[1::-1]) / np.array(depth_m.shape[::-1])
        overlaps = [_overlap(corners * scale, colour) for colour in candidates]
        if overlaps and max(overlaps) >= _OVERLAP:
            refined = _refine_corners(grey, candidates[int(np.argmax(overlaps))])
            return None if refined is None else BoardView(refined, corners, z)
    return None


def _in_depth(depth_m: npt.NDArray[np.float32]) -> list[tuple[Floats, Floats]]:
    """Return corners and their depths of all flat quadrangles, the nearest first."""
    known = np.where(np.isfinite(depth_m), depth_m, np.float32(0.0))
    smooth = cv2.medianBlur(known, 5)
    inside = (smooth > 0.0).astype(np.uint8)
    inside[:, :-1] &= np.abs(np.diff(smooth, axis=1)) < _STEP * smooth[:, :-1]
    inside[:-1] &= np.abs(np.diff(smooth, axis=0)) < _STEP * smooth[:-1]
    found = []
    for mask in _patches(inside):
        whole = np.asarray(cv2.dilate(mask, np.array([[1, 1], [1, 1]], np.uint8), anchor=(1, 1)), np.uint8)
        corners = _quadrangle(whole, 0.5)
        if corners is None or _touches(corners, depth_m.shape):
            continue
        z = _plane(np.asarray(smooth, np.float32), mask, corners)
        if z is not None:
            found.append((corners, z))
    return sorted(found, key=lambda pair: float(pair[1].mean()))


def _in_colour(grey: Grey8) -> list[Floats]:
    """Return corners of the quadrangles that edges enclose."""
    found: list[Floats] = []
    smooth = cv2.GaussianBlur(grey, (5, 5), 0)
    for low, high in ((20, 60), (40, 120)):
        edges = cv2.dilate(cv2.Canny(smooth, low, high), np.ones((3, 3), np.uint8))
        for mask in _patches((edges == 0).astype(np.uint8)):
            corners = _quadrangle(mask, 2.0)
            if corners is not None and not _touches(corners, grey.shape):
                found.append(corners)
    return found


def _patches(inside: Grey8) -> list[Grey8]:
    n, labels, stats, _ = cv2.connectedComponentsWithStats(inside, connectivity=4, ltype=cv2.CV_32S)
    area = np.asarray(stats)[:n, cv2.CC_STAT_AREA]
    good = np.flatnonzero((area > _MIN_SHARE * inside.size) & (area < _MAX_SHARE * inside.size))
    return [(np.asarray(labels) == label).astype(np.uint8) for label in good if label != 0]


def _quadrangle(mask: Grey8, outwards_px: float) -> Floats | None:
    """Return the corners of a mask that is a convex quadrangle, its sides moved outwards."""
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    contour: Any = max(contours, key=cv2.contourArea)
    hull = cv2.convexHull(contour)
    if cv2.contourArea(contour) < _MIN_FILL * cv2.contourArea(hull):
        return None
    length = cv2.arcLength(hull, closed=True)
    for share in (0.01, 0.02, 0.03, 0.05):
        polygon = cv2.approxPolyDP(hull, share * length, closed=True).reshape(-1, 2).astype(np.float64)
        if len(polygon) == 4:
            break
    if len(polygon) != 4:
        return None
    points = contour.reshape(-1, 2).astype(np.float64)
    corners = _clockwise(polygon)
    lines = [_side(points, corners[i], corners[(i + 1) % 4], outwards_px) for i in range(4)]
    if any(line is None for line in lines):
        return None
    return _corners_of(lines)  # type: ignore[arg-type]


def _side(points: Floats, a: Floats, b: Floats, outwards_px: float) -> tuple[Floats, Floats] | None:
    """Return a point and the normal of the line through the contour between two corners."""
    along = (b - a) / np.linalg.norm(b - a)
    out = np.array([along[1], -along[0]])  # to the left when walking clockwise in a picture
    share = (points - a) @ along / np.linalg.norm(b - a)
    near = points[(np.abs((points - a) @ out) < 4.0) & (share > 0.08) & (share < 0.92)]
    if len(near) < 8:
        return None
    return _line(near, out, outwards_px)


def _line(points: Floats, out: Floats, outwards_px: float) -> tuple[Floats, Floats]:
    fitted = np.asarray(cv2.fitLine(points.astype(np.float32), cv2.DIST_HUBER, 0, 0.01, 0.01), np.float64).ravel()
    normal = np.array([fitted[1], -fitted[0]])
    normal *= np.sign(normal @ out) or 1.0
    return fitted[2:] + outwards_px * normal, normal


def _corners_of(lines: list[tuple[Floats, Floats]]) -> Floats | None:
    """Return where each side meets the one before, (4, 2): the corners at which the sides begin."""
    corners = np.empty((4, 2))
    for i in range(4):
        (p, n), (q, m) = lines[i - 1], lines[i]
        both = np.stack([n, m])
        if abs(np.linalg.det(both)) < 0.2:
            return None
        corners[i] = np.linalg.solve(both, [n @ p, m @ q])
    return corners


def _clockwise(polygon: Floats) -> Floats:
    """Return corners clockwise, as the picture shows them, from the upper left."""
    away = polygon - polygon.mean(axis=0)
    ordered = polygon[np.argsort(np.arctan2(away[:, 1], away[:, 0]))]
    return np.roll(ordered, -int(ordered.sum(axis=1).argmin()), axis=0)


def _touches(corners: Floats, shape: tuple[int, ...]) -> bool:
    margin = 3.0
    return bool((corners < margin).any() or (corners > np.array(shape[1::-1]) - 1.0 - margin).any())


def _plane(depth_m: npt.NDArray[np.float32], mask: Grey8, corners: Floats) -> Floats | None:
    """Return the depths of corners of the plane through a mask; None where it is not flat.

    The inverse depth of a plane is linear in the pixel.
    """
    core = cv2.erode(mask, np.ones((7, 7), np.uint8))
    v, u = np.nonzero(core)
    if len(u) < 100:
        return None
    A = np.stack([u, v, np.ones(len(u))], axis=1).astype(np.float64)
    inverse = 1.0 / depth_m[v, u].astype(np.float64)
    plane, *_ = np.linalg.lstsq(A, inverse, rcond=None)
    misses = np.abs(A @ plane / inverse - 1.0)
    if np.median(misses) > _OFF_PLANE / 2.0 or np.quantile(misses, 0.95) > _OFF_PLANE:
        return None
    at_corners = np.column_stack([corners, np.ones(4)]) @ plane
    return 1.0 / at_corners if (at_corners > 0.0).all() else None


def _overlap(first: Floats, second: Floats) -> float:
    """Return the shared area of two convex quadrangles by that of both together."""
    shared, _ = cv2.intersectConvexConvex(first.astype(np.float32), second.astype(np.float32))
    areas = [float(cv2.contourArea(corners.astype(np.float32))) for corners in (first, second)]
    return float(shared) / max(sum(areas) - float(shared), 1e-9)


def _refine_corners(grey: Grey8, corners: Floats) -> Floats | None:
    """Return the corners where the edges are steepest, to a share of a pixel."""
    smooth = cv2.GaussianBlur(grey, (5, 5), 0).astype(np.float32)
    steps = np.arange(-_SEARCH_PX, _SEARCH_PX + 1)
    lines = []
    for i in range(4):
        a, b = corners[i], corners[(i + 1) % 4]
        along = (b - a) / np.linalg.norm(b - a)
        out = np.array([along[1], -along[0]])
        at = a + np.linspace(0.1, 0.9, _N_PROFILES)[:, None] * (b - a)
        profile = at[:, None] + steps[None, :, None] * out
        seen = cv2.remap(
            smooth, profile[..., 0].astype(np.float32), profile[..., 1].astype(np.float32), cv2.INTER_LINEAR
        )
        slope = np.abs(np.asarray(seen)[:, 2:] - np.asarray(seen)[:, :-2])
        best = np.clip(slope.argmax(axis=1), 1, slope.shape[1] - 2)
        row = np.arange(len(best))
        before, peak, after = slope[row, best - 1], slope[row, best], slope[row, best + 1]
        bend = np.minimum(before - 2.0 * peak + after, -1e-6)
        offset = best + 1 + np.clip(0.5 * (before - after) / bend, -1.0, 1.0) - _SEARCH_PX
        strong = peak > 0.3 * np.median(peak)
        if strong.sum() < _N_PROFILES // 2:
            return None
        lines.append(_line(at[strong] + offset[strong, None] * out, out, 0.0))
    return _corners_of(lines)
