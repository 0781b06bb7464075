"""Follow scans while a place is taught: each lies on those remembered just before it.

What is mapped from the belief inherits the belief's error, so a match to it is no absolute pose: it tells how base
moved since the last scan. Along a corridor it tells nothing, and the way that the odometry says is kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Lost, Motion
from trailmark.geometry import Pose2, rotate_axes
from trailmark.geometry.walls import limited_information, measured_directions, measured_information, measured_step
from trailmark_omni_surf.laser.growing_map import GrowingMap
from trailmark_omni_surf.laser.kernels import normal_equations, score_starts
from trailmark_omni_surf.laser.matching import FINE_GATES_M, FIT_GATE_M, ScanMatch, SearchWindow, match_scan
from trailmark_omni_surf.laser.scan_map import ScanMap

__all__ = ["FollowedScan", "ScanFollower", "match_held", "told_fit"]

# Wheels that slip in a turn are off by more than the search against a finished map allows for.
_WIDE_RAD = math.radians(40.0)
# A scan that fits like this needs no other starts; another must fit clearly better [m].
_GOOD_SHARE, _CLEARLY_M = 0.85, 0.01
_GATES_M = (0.5, *FINE_GATES_M.tolist())
_ITERATIONS = 8
#: What no match is better than: position [m] and heading [rad].
_SIGMA = (0.003, math.radians(0.08))
_NOISE_M, _CORRELATION = 0.015, 10.0


@dataclass(frozen=True, slots=True, eq=False)
class FollowedScan:
    """What a scan gives while a place is taught: motion, and the correction of the pose.

    Attributes
    ----------
    answer : Motion, Lost or None
        Motion since the scan before; None where there was none to compare it with.
    correction : Pose2
        Base as the scan tells it, seen from where the odometry since the scan before has led.
    """

    answer: Motion | Lost | None
    correction: Pose2 = Pose2()


@dataclass(frozen=True, slots=True)
class _Last:
    """The scan before: when, where in the local map, and where the belief's odometry was."""

    stamp_s: float
    pose: Pose2
    pose_odom_base: Pose2
    is_matched: bool


class ScanFollower:
    """Matches each scan to those remembered on the last stretch of way, in axes of its own.

    Parameters
    ----------
    window : SearchWindow
        How far around the expected pose is searched.
    min_inlier_share : float
        Below this share of points near the map, the scan does not fit.
    """

    def __init__(self, window: SearchWindow, min_inlier_share: float) -> None:
        wide_rad = max(window.span_rad, _WIDE_RAD)
        self._window, self._min_inlier_share = replace(window, span_rad=wide_rad), min_inlier_share
        self._map = GrowingMap()
        self._last: _Last | None = None

    def follow(self, stamp_s: float, points_base: Floats, pose_odom_base: Pose2) -> FollowedScan:
        """Return the motion since the scan before.

        Parameters
        ----------
        stamp_s : float
            Of the scan [s].
        points_base : (N, 2) float64
            Its points in base axes [m].
        pose_odom_base : Pose2
            Where motion alone has carried base, as believed now.
        """
        last = self._last
        if last is None:
            self._last = _Last(stamp_s, Pose2(), pose_odom_base, True)
            return FollowedScan(None)
        expected = last.pose @ last.pose_odom_base.between(pose_odom_base)
        if not self._map.knows(expected):
            self._last = _Last(stamp_s, expected, pose_odom_base, True)
            return FollowedScan(None)
        match = match_held(self._map.scan_map(), points_base, expected, self._window)
        details = {"inlier_share": match.inlier_share, "residual_m": match.residual_m, "cost_m": match.cost_m}
        if match.inlier_share < self._min_inlier_share:  # go on from where the odometry leads
            self._last = _Last(stamp_s, expected, pose_odom_base, False)
            reason = f"the scan does not fit those before it ({match.inlier_share:.0%} of its points do)"
            return FollowedScan(Lost(stamp_s, reason, details))
        self._last = _Last(stamp_s, match.pose_map_base, pose_odom_base, True)
        correction = expected.between(match.pose_map_base)
        if not last.is_matched or stamp_s <= last.stamp_s or not match.information.any():
            return FollowedScan(None, correction)
        step = last.pose.between(match.pose_map_base)
        information = rotate_axes(match.information, -last.pose.theta)
        return FollowedScan(Motion(last.stamp_s, stamp_s, step, information, details), correction)

    def remember(self, points_base: Floats) -> None:
        """Add the scan that was followed last to those that the next ones are matched to."""
        assert self._last is not None
        self._map.add(points_base, self._last.pose)


def match_held(scan_map: ScanMap, points_base: Floats, guess: Pose2, window: SearchWindow) -> ScanMatch:
    """Return the fit of a scan nearest to a guess, held at the guess in directions that no wall measures.

    Other starts of the window are tried where the scan does not fit well; a fit from there must be clearly better.

    Parameters
    ----------
    scan_map : ScanMap
        The scans before.
    points_base : (N, 2) float64
        Points of the scan in base axes [m].
    guess : Pose2
        Where it is expected.
    window : SearchWindow
        How far around it other starts lie.
    """
    points = np.ascontiguousarray(points_base, dtype=np.float64)
    match = _refined_held(scan_map, points, guess)
    if match.inlier_share >= _GOOD_SHARE:
        return match
    other = told_fit(scan_map, points, match_scan(scan_map, points, guess, window).pose_map_base, guess)
    return other if other.cost_m < match.cost_m - _CLEARLY_M else match


def told_fit(scan_map: ScanMap, points: Floats, pose: Pose2, guess: Pose2) -> ScanMatch:
    """Return the fit at a pose, held at a guess in directions that no wall measures."""
    return _refined_held(scan_map, points, _told_part(scan_map, points, pose, guess))


def _told_part(scan_map: ScanMap, points: Floats, pose: Pose2, guess: Pose2) -> Pose2:
    """Return the pose that differs from a guess as another does, in directions that walls measure."""
    hessian, _, _, n_fit = _equations(scan_map, points, pose.array(), FIT_GATE_M)
    _, vectors, is_told = measured_directions(hessian, n_fit)
    away = pose.array() - guess.array()
    away[2] = math.remainder(away[2], 2.0 * math.pi)
    told = vectors[:, is_told]
    return Pose2.from_array(guess.array() + told @ (told.T @ away))


def _refined_held(scan_map: ScanMap, points: Floats, start: Pose2) -> ScanMatch:
    pose = start.array()
    for gate_m in _GATES_M:
        for _ in range(_ITERATIONS):
            hessian, gradient, _, n_fit = _equations(scan_map, points, pose, gate_m)
            if n_fit < 6:
                return ScanMatch(start, np.zeros((3, 3)), 0.0, math.inf, scan_map.reach_m, math.inf)
            step = measured_step(hessian, gradient, n_fit)
            pose = pose - step
            if np.abs(step).max() < 1e-4:
                break
    hessian, _, squared, n_fit = _equations(scan_map, points, pose, FIT_GATE_M)
    residual_m = math.sqrt(squared / max(n_fit, 1))
    information = measured_information(hessian, n_fit) / (_CORRELATION * max(_NOISE_M, residual_m) ** 2)
    raster = (scan_map.origin, scan_map.cell_m, scan_map.distance_m, scan_map.reach_m)
    cost_m = float(score_starts(points, pose[np.newaxis], *raster)[0])
    limited = limited_information(information, _SIGMA)
    return ScanMatch(Pose2.from_array(pose), limited, n_fit / len(points), residual_m, cost_m, math.inf)


def _equations(scan_map: ScanMap, points: Floats, pose: Floats, gate_m: float) -> tuple[Floats, Floats, float, int]:
    hessian, gradient = np.empty((3, 3)), np.empty(3)
    squared, n_fit = normal_equations(
        points, pose, scan_map.points, scan_map.normals, scan_map.origin, scan_map.cell_m, scan_map.nearest_idx,
        gate_m, True, hessian, gradient,
    )  # fmt: skip
    return hessian, gradient, squared, n_fit
