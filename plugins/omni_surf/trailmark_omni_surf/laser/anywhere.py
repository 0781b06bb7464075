"""Where in the whole taught place a scan was taken: start poses all over it, and whether one of them stands out."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from trailmark.arrays import Floats
from trailmark.geometry import Pose2
from trailmark.paths import Keyframe
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

__all__ = ["AnywhereMatcher", "AnywhereSearch", "least_share"]

_CELL_M = 0.3  # of start positions
_N_HEADINGS = 60
_ASIDE_M = 1.0  # start positions lie as far from the taught way as this
_MOST_POSITIONS = 20_000
_N_BEAMS = 60  # of a scan that start poses are scored on
_N_CONSIDERED, _N_COARSE, _N_FINE = 4_000, 80, 16
_APART = 0.5, math.radians(20.0)  # of start poses that are refined coarsely
#: A scan counts where its fit costs so much less than any elsewhere. Chosen on every other scan of Freiburg 079.
_STANDS_OUT_M = 0.015
#: Some pose fits best in any building, and stands out: in simulated offices that were not taught, single scans and
#: three in a row lay to 94 to 96 % on walls of another one, as much as right ones do in a place that is less tidy.
#: So a scan must be explained nearly as well as those with which this place was taught, so many scans must lead to
#: the same pose, and few between them to none or elsewhere. Where nobody taught, a right pose explains 0.6 to 0.85
#: of a scan, and is not found.
_LEAST_SHARE, _N_TOGETHER, _AGREEING = 0.9, 5, 0.8
#: Of the taught scans this share is explained worse than the others; a new scan may be by so much more.
_WORST_TAUGHT, _LESS_THAN_TAUGHT, _N_TAUGHT, _NEAR_M = 0.1, 0.02, 60, 0.1
_MOVED_M, _MOVED_RAD = 0.15, math.radians(10.0)  # nearer scans see the same
_SAME = 0.3, math.radians(6.0)
_MEMORY = 12  # scans


def least_share(scan_map: ScanMap, keyframes: Sequence[Keyframe]) -> float:
    """Return how much of a scan a pose in this place must explain, from what the taught poses explain of theirs."""
    walls = cKDTree(scan_map.points)
    shares = []
    for keyframe in keyframes[:: math.ceil(len(keyframes) / _N_TAUGHT)]:
        points = keyframe.pose_map_base @ keyframe.arrays["points"].astype(np.float64)
        distances, _ = walls.query(points, distance_upper_bound=_NEAR_M)
        shares.append(float(np.isfinite(distances).mean()))
    return max(_LEAST_SHARE, float(np.quantile(shares, _WORST_TAUGHT)) - _LESS_THAN_TAUGHT)


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


@dataclass(frozen=True, slots=True)
class _Look:
    """Where odometry was at a scan, and the pose that stood out in the map, if any."""

    pose_odom_base: Pose2
    pose_map_base: Pose2 | None

    def agrees_with(self, before: _Look) -> bool:
        """Return whether an earlier pose, moved by odometry, leads to this one."""
        if self.pose_map_base is None or before.pose_map_base is None:
            return False
        led_to = before.pose_map_base @ before.pose_odom_base.between(self.pose_odom_base)
        off = led_to.between(self.pose_map_base)
        return math.hypot(off.x, off.y) < _SAME[0] and abs(off.theta) < _SAME[1]


class AnywhereSearch:
    """Finds a robot in the taught place without a belief, from several scans along its way.

    Parameters
    ----------
    matcher : AnywhereMatcher
        Matches each scan.
    least_share : float
        A scan of which less fits is not counted; see `least_share`.
    """

    def __init__(self, matcher: AnywhereMatcher, least_share: float) -> None:
        self._matcher = matcher
        self._least_share = least_share
        self._last_odom: Pose2 | None = None
        self._looks: deque[_Look] = deque(maxlen=_MEMORY)

    def is_new(self, pose_odom_base: Pose2) -> bool:
        """Return whether a scan here may say more than the last one."""
        return self._last_odom is None or _has_moved(pose_odom_base, self._last_odom)

    def update(self, points_base: Floats, pose_odom_base: Pose2, *, to_line: bool = True) -> tuple[ScanMatch, bool]:
        """Return the best fit of a scan in the whole place, and whether it is accepted as the robot's pose."""
        self._last_odom = pose_odom_base
        match = self._matcher.match(points_base, to_line=to_line)
        margin_m = match.runner_up_cost_m - match.cost_m
        if match.inlier_share < self._least_share or margin_m < _STANDS_OUT_M:
            self._looks.append(_Look(pose_odom_base, None))
            return match, False
        self._looks.append(_Look(pose_odom_base, match.pose_map_base))
        return match, self._is_confirmed()

    def _is_confirmed(self) -> bool:
        """Return whether enough looks lead to the place of the last one, and nearly all since the first of them."""
        last = self._looks[-1]
        agrees = [last.agrees_with(one) for one in self._looks]
        since_first = agrees[agrees.index(True) :]
        return sum(agrees) >= _N_TOGETHER and sum(agrees) >= _AGREEING * len(since_first)


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
