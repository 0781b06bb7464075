"""Poses in closed form, from as few numbers as determine one."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations, islice

import numpy as np

from trailmark.arrays import Floats

__all__ = ["candidate_poses", "pose_from_three_bearings", "poses_from_two_ranges"]

_MOST_OF_A_KIND = 120
#: Subsets are gone through one by one to choose an even part of them, so not of thousands of sightings.
_MOST_CHOSEN_FROM = 60
_SMALL = 1e-9


def candidate_poses(landmarks: Floats, ranges_m: Floats, bearings_rad: Floats) -> Floats:
    """Return poses of the sensor that a few of the sightings hold exactly for, (C, 3) [m, m, rad].

    Two landmarks seen at range and bearing, two ranges and a bearing, or three bearings; an even choice where there
    are many of a kind.

    Parameters
    ----------
    landmarks : (N, 2) float64
        Their places [m].
    ranges_m, bearings_rad : (N,) float64
        What is seen of each, NaN where it is not.
    """
    has_range, has_bearing = np.isfinite(ranges_m), np.isfinite(bearings_rad)
    poses: list[Floats] = []
    for i, j in _choose(np.flatnonzero(has_range & has_bearing), 2):
        poses.append(_pose_from_two_points(landmarks[[i, j]], ranges_m[[i, j]], bearings_rad[[i, j]]))
    if has_bearing.any():
        first = int(np.flatnonzero(has_bearing)[0])
        for i, j in _choose(np.flatnonzero(has_range), 2):
            for x, y in poses_from_two_ranges(landmarks[[i, j]], ranges_m[[i, j]]):
                towards = math.atan2(landmarks[first, 1] - y, landmarks[first, 0] - x)
                poses.append(np.array([x, y, towards - bearings_rad[first]]))
    for i, j, k in _choose(np.flatnonzero(has_bearing), 3):
        pose = pose_from_three_bearings(landmarks[[i, j, k]], bearings_rad[[i, j, k]])
        if pose is not None:
            poses.append(pose)
    return np.array(poses).reshape(-1, 3)


def _choose(indices: np.ndarray, size: int) -> Iterator[tuple[int, ...]]:
    """Yield subsets of a size, every so many where there are more than wanted."""
    indices = indices[:: math.ceil(len(indices) / _MOST_CHOSEN_FROM) or 1]
    every = max(1, math.ceil(math.comb(len(indices), size) / _MOST_OF_A_KIND))
    return islice(combinations(indices.tolist(), size), 0, None, every)


def _pose_from_two_points(landmarks: Floats, ranges_m: Floats, bearings_rad: Floats) -> Floats:
    """Return the pose that turns two points seen in sensor axes onto their landmarks, (3,)."""
    seen = np.stack([ranges_m * np.cos(bearings_rad), ranges_m * np.sin(bearings_rad)], axis=1)
    there, here = landmarks[1] - landmarks[0], seen[1] - seen[0]
    theta = math.atan2(there[1], there[0]) - math.atan2(here[1], here[0])
    cos, sin = math.cos(theta), math.sin(theta)
    x, y = seen.mean(axis=0)
    middle = landmarks.mean(axis=0)
    return np.array([middle[0] - (cos * x - sin * y), middle[1] - (sin * x + cos * y), theta])


def poses_from_two_ranges(landmarks: Floats, ranges_m: Floats) -> list[tuple[float, float]]:
    """Return the places at two distances from two landmarks: two, or one where the circles only just meet [m]."""
    dx, dy = landmarks[1] - landmarks[0]
    apart_m = math.hypot(dx, dy)
    if apart_m < _SMALL:
        return []
    along = (apart_m**2 + ranges_m[0] ** 2 - ranges_m[1] ** 2) / (2.0 * apart_m)
    across = math.sqrt(max(0.0, ranges_m[0] ** 2 - along**2))
    x, y = landmarks[0] + along / apart_m * np.array([dx, dy])
    aside_x, aside_y = -dy / apart_m * across, dx / apart_m * across
    both = [(float(x + aside_x), float(y + aside_y)), (float(x - aside_x), float(y - aside_y))]
    return both if across > _SMALL else both[:1]


def pose_from_three_bearings(landmarks: Floats, bearings_rad: Floats) -> Floats | None:
    """Return the pose that sees three landmarks under three bearings (Pierlot & Van Droogenbroeck 2014, ToTal).

    Each pair of bearings says a circle through its two landmarks; the robot stands where the three meet.

    Returns
    -------
    (3,) float64 or None
        None where the circles are one: the robot and the landmarks lie on a circle, or on a line.
    """
    (x1, y1), (x3, y3) = landmarks[0] - landmarks[1], landmarks[2] - landmarks[1]
    t12 = _cot(bearings_rad[1] - bearings_rad[0])
    t23 = _cot(bearings_rad[2] - bearings_rad[1])
    if abs(t12 + t23) < _SMALL:
        return None
    t31 = (1.0 - t12 * t23) / (t12 + t23)
    x12, y12 = x1 + t12 * y1, y1 - t12 * x1
    x23, y23 = x3 - t23 * y3, y3 + t23 * x3
    x31, y31 = (x3 + x1) + t31 * (y3 - y1), (y3 + y1) - t31 * (x3 - x1)
    k31 = x1 * x3 + y1 * y3 + t31 * (x1 * y3 - x3 * y1)
    determinant = (x12 - x23) * (y23 - y31) - (y12 - y23) * (x23 - x31)
    if abs(determinant) < _SMALL:
        return None
    x = landmarks[1, 0] + k31 * (y12 - y23) / determinant
    y = landmarks[1, 1] + k31 * (x23 - x12) / determinant
    return np.array([x, y, math.atan2(landmarks[0, 1] - y, landmarks[0, 0] - x) - bearings_rad[0]])


def _cot(angle: float) -> float:
    """Return the cotangent, large but finite at zero."""
    sin = math.sin(angle)
    return math.cos(angle) / (sin if abs(sin) > _SMALL else math.copysign(_SMALL, sin))
