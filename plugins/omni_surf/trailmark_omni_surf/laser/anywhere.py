"""Where in the whole taught place a scan was taken: start poses all over it, and whether one of them stands out."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Pose2
from trailmark_omni_surf.laser.kernels import score_starts
from trailmark_omni_surf.laser.matching import (
    COARSE_GATES_M,
    FINE_GATES_M,
    ScanMatch,
    best_fit,
    is_elsewhere,
    refine_all,
)
from trailmark_omni_surf.laser.scan_map import ScanMap

__all__ = ["AnywhereMatcher", "AnywhereSearch"]

_CELL_M = 0.3  # of start positions
_N_HEADINGS = 60
_ASIDE_M = 1.0  # start positions lie as far from the taught way as this
_MOST_POSITIONS = 20_000
_N_BEAMS = 60  # of a scan that start poses are scored on
_N_CONSIDERED, _N_COARSE, _N_FINE = 4_000, 80, 16
_APART = 0.5, math.radians(20.0)  # of start poses that are refined coarsely
#: A scan whose fit costs this much less than any elsewhere is believed alone; one that stands out by the lesser margin
#: when scans before it, taken elsewhere, led to the same place. Chosen on every other scan of one log (Freiburg 079).
_ALONE_M, _TOGETHER_M = 0.06, 0.015
_N_TOGETHER = 3
#: Some pose fits best in any building. In simulated offices and halls right poses explain 0.94 of a scan and more, the
#: best of a robot that stands where nothing was taught mostly 0.89 at most, and stand out all the same.
_LEAST_SHARE = 0.9
_MOVED_M, _MOVED_RAD = 0.15, math.radians(10.0)  # nearer scans see the same
_SAME = 0.3, math.radians(6.0)
_MEMORY = 12  # scans


class AnywhereMatcher:
    """Matches scans to a map without a guess.

    Parameters
    ----------
    scan_map : ScanMap
        The taught place.
    poses : sequence of Pose2
        Where it was taught: the robot is looked for within a metre of these.
    """

    def __init__(self, scan_map: ScanMap, poses: list[Pose2]) -> None:
        self._map = scan_map
        self._positions = _positions(np.array([[pose.x, pose.y] for pose in poses]))

    def match(self, points_base: Floats, *, to_line: bool = True) -> ScanMatch:
        """Return the best fit of a scan anywhere in the place; its runner-up is the best elsewhere in all of it."""
        scan_map = self._map
        raster = (scan_map.origin, scan_map.cell_m, scan_map.distance_m, scan_map.reach_m)
        points = np.ascontiguousarray(points_base, dtype=np.float64)
        thinned = np.ascontiguousarray(points[:: max(1, len(points) // _N_BEAMS)])
        starts = self._starts()
        coarse = _apart(starts, score_starts(thinned, starts, *raster), _N_COARSE, _N_CONSIDERED)
        coarse = refine_all(scan_map, thinned, coarse, COARSE_GATES_M, to_line)
        fine = _apart(coarse, score_starts(points, coarse, *raster), _N_FINE, _N_COARSE)
        fine = refine_all(scan_map, points, fine, FINE_GATES_M, to_line)
        return best_fit(scan_map, points, (fine, score_starts(points, fine, *raster)), to_line=to_line)

    def _starts(self) -> Floats:
        headings = 2.0 * math.pi * np.arange(_N_HEADINGS) / _N_HEADINGS
        positions = np.repeat(self._positions, _N_HEADINGS, axis=0)
        return np.column_stack([positions, np.tile(headings, len(self._positions))])


class AnywhereSearch:
    """Finds a robot in the taught place without a belief, from one scan or several along its way.

    Parameters
    ----------
    matcher : AnywhereMatcher
        Matches each scan.
    min_inlier_share : float
        A scan of which less fits is not counted.
    """

    def __init__(self, matcher: AnywhereMatcher, min_inlier_share: float) -> None:
        self._matcher = matcher
        self._min_inlier_share = min_inlier_share
        self._last_odom: Pose2 | None = None
        self._found: deque[tuple[Pose2, Pose2]] = deque(maxlen=_MEMORY)  # in odom, and in the map

    def is_new(self, pose_odom_base: Pose2) -> bool:
        """Return whether a scan here may say more than the last one."""
        return self._last_odom is None or _has_moved(pose_odom_base, self._last_odom)

    def update(self, points_base: Floats, pose_odom_base: Pose2, *, to_line: bool = True) -> tuple[ScanMatch, bool]:
        """Return the best fit of a scan in the whole place, and whether it is accepted as the robot's pose."""
        self._last_odom = pose_odom_base
        match = self._matcher.match(points_base, to_line=to_line)
        margin_m = match.runner_up_cost_m - match.cost_m
        if match.inlier_share < max(_LEAST_SHARE, self._min_inlier_share) or margin_m < _TOGETHER_M:
            return match, False
        n_agree = sum(self._leads_to(match.pose_map_base, pose_odom_base, before) for before in self._found)
        if all(_has_moved(pose_odom_base, odom) for odom, _ in self._found):
            self._found.append((pose_odom_base, match.pose_map_base))
        return match, margin_m >= _ALONE_M or n_agree + 1 >= _N_TOGETHER

    @staticmethod
    def _leads_to(pose_map_base: Pose2, pose_odom_base: Pose2, before: tuple[Pose2, Pose2]) -> bool:
        """Return whether an earlier fit, moved by odometry, leads to the present one."""
        odom, pose_map_before = before
        if not _has_moved(pose_odom_base, odom):
            return False
        led_to = pose_map_before @ odom.between(pose_odom_base)
        return led_to.distance_to(pose_map_base) < _SAME[0] and abs(led_to.between(pose_map_base).theta) < _SAME[1]


def _has_moved(pose: Pose2, before: Pose2) -> bool:
    return before.distance_to(pose) > _MOVED_M or abs(before.between(pose).theta) > _MOVED_RAD


def _positions(taught: Floats) -> Floats:
    """Return a grid over all that lies near the taught way, (P, 2) [m]; coarser where that would be too much."""
    cell_m = _CELL_M
    while True:
        reach = math.ceil(_ASIDE_M / cell_m)
        steps = np.arange(-reach, reach + 1)
        around = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        around = around[np.hypot(*around.T) * cell_m <= _ASIDE_M]
        ways = np.unique(np.round(taught / cell_m).astype(np.int64), axis=0)
        cells = np.unique((ways[:, None] + around[None]).reshape(-1, 2), axis=0)
        if len(cells) <= _MOST_POSITIONS:
            return np.asarray(cells * cell_m, dtype=np.float64)
        cell_m *= 1.5


def _apart(poses: Floats, costs: Floats, count: int, n_considered: int) -> Floats:
    """Return the best poses, none near a better one."""
    order = np.argsort(costs, kind="stable")[:n_considered]
    left, kept = poses[order], list[Floats]()
    while len(left) and len(kept) < count:
        kept.append(left[0])
        left = left[is_elsewhere(left, left[0], _APART)]
    return np.array(kept)
