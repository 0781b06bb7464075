"""Motion from planar scans: each lies on those before it, in axes of its own.

Where walls tell nothing, as along a corridor, the way that the odometry says is kept, and has no information.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Lost, Motion
from trailmark.geometry import Pose2
from trailmark.geometry.scans.local_map import LocalMap, LocalMatch
from trailmark.geometry.scans.uncertainty import step_information

__all__ = ["FollowedScan", "FollowingRules", "ScanFollower"]

_MIN_POINTS = 20
#: A match this good needs no other guesses; else turns of base from which it is tried again [deg].
_GOOD_SHARE, _TURNS_DEG = 0.85, (-24.0, -16.0, -8.0, 8.0, 16.0, 24.0)
#: Half of a scan nearer than this is left out: the next one that sees more is matched to the same scans [m].
_COVERED_M = 0.4
#: The first scan lies on its local map by definition.
_EXACT = 1e12 * np.eye(3)


@dataclass(frozen=True, slots=True)
class FollowingRules:
    """What scans are matched to, and when they match.

    Attributes
    ----------
    keep_scans : int
        So many scans of the last way are matched to.
    keyscan_m, keyscan_rad : float
        A scan joins them every so far, or after a turn of this much [m, rad].
    n_rays : int
        Rays of a scan that are matched, spread evenly.
    min_share : float
        Below this share of points within 0.15 m of the scans before, a scan does not match.
    sigma_m : float
        Standard deviation of the distance of a return to its wall; the residual takes its place where larger [m].
    """

    keep_scans: int = 12
    keyscan_m: float = 0.25
    keyscan_rad: float = math.radians(10.0)
    n_rays: int = 240
    min_share: float = 0.6
    sigma_m: float = 0.015


@dataclass(frozen=True, slots=True, eq=False)
class FollowedScan:
    """What a scan tells beside those before it.

    Attributes
    ----------
    answer : Motion, Lost or None
        Motion since the last scan that matched; None where there was none to compare it with.
    correction : Pose2
        Base as the scan tells it, seen from where the odometry since then has led.
    shows_place : bool
        Whether the scan shows the place: not one of something that covers the laser.
    """

    answer: Motion | Lost | None
    correction: Pose2 = Pose2()
    shows_place: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class _Matched:
    """The last scan: when, where in the local map and how surely, where the belief's odometry was, the step to it."""

    stamp_s: float
    pose: Pose2
    pose_odom_base: Pose2
    step: Pose2
    information: Floats


class ScanFollower:
    """Matches each scan to the last ones, point to line.

    The search begins where the belief expects the robot, and where the last step would lead it again. Where a scan does
    not match, a new local map begins with it.

    Parameters
    ----------
    pose_base_laser : Pose2
        Where the laser is on the robot.
    rules : FollowingRules
        What scans are matched to, and when they match.
    """

    def __init__(self, pose_base_laser: Pose2, rules: FollowingRules) -> None:
        self._pose_base_laser, self._rules = pose_base_laser, rules
        self._map = LocalMap(rules.keep_scans)
        self._last: _Matched | None = None
        self._keyscan = Pose2()

    def follow(self, stamp_s: float, points_base: Floats, pose_odom_base: Pose2) -> FollowedScan:
        """Return the motion since the last scan that matched.

        Parameters
        ----------
        stamp_s : float
            Of the scan [s].
        points_base : (N, 2) float64
            Its points in base axes, in the order of the rays [m].
        pose_odom_base : Pose2
            Where motion alone has carried base, as believed now.
        """
        if len(points_base) < _MIN_POINTS:
            return FollowedScan(Lost(stamp_s, f"only {len(points_base)} returns"), shows_place=False)
        if self._is_covered(points_base):
            reason = f"half of the returns are nearer than {_COVERED_M} m: something covers the laser"
            return FollowedScan(Lost(stamp_s, reason), shows_place=False)
        last = self._last
        if last is None or stamp_s <= last.stamp_s:
            self._begin(stamp_s, points_base, pose_odom_base)
            return FollowedScan(None)
        expected = last.pose @ last.pose_odom_base.between(pose_odom_base)
        match = self._match(last, points_base, expected)
        if match.share < self._rules.min_share:
            self._begin(stamp_s, points_base, pose_odom_base)
            reason = f"only {match.share:.0%} of the scan lies on those before it"
            return FollowedScan(Lost(stamp_s, reason, _details(match)))
        motion = _motion(last, stamp_s, match)
        self._last = _Matched(stamp_s, match.pose, pose_odom_base, motion.pose_since_now, match.information)
        self._add_when_new(match, points_base)
        return FollowedScan(motion, expected.between(match.pose))

    def _is_covered(self, points: Floats) -> bool:
        """Whether hardly more is seen than something that stands close by, and may walk along."""
        offsets = points - (self._pose_base_laser.x, self._pose_base_laser.y)
        return float(np.median(np.hypot(offsets[:, 0], offsets[:, 1]))) < _COVERED_M

    def _begin(self, stamp_s: float, points: Floats, pose_odom_base: Pose2) -> None:
        """Begin a local map with this scan."""
        self._map = LocalMap(self._rules.keep_scans)
        self._map.add(Pose2(), points)
        self._keyscan = Pose2()
        self._last = _Matched(stamp_s, Pose2(), pose_odom_base, Pose2(), _EXACT)

    def _match(self, last: _Matched, points: Floats, expected: Pose2) -> LocalMatch:
        rays = points[np.linspace(0, len(points) - 1, min(self._rules.n_rays, len(points))).astype(int)]
        match = self._map.match(rays, [expected, last.pose @ last.step], self._rules.sigma_m)
        if match.share >= _GOOD_SHARE:
            return match
        turned = [expected @ Pose2(0.0, 0.0, math.radians(turn)) for turn in _TURNS_DEG]
        return self._map.match(rays, [match.pose, *turned], self._rules.sigma_m)

    def _add_when_new(self, match: LocalMatch, points: Floats) -> None:
        way, rules = self._keyscan.between(match.pose), self._rules
        is_far = math.hypot(way.x, way.y) >= rules.keyscan_m or abs(way.theta) >= rules.keyscan_rad
        if is_far or match.share < _GOOD_SHARE:
            self._map.add(match.pose, points)
            self._keyscan = match.pose


def _motion(last: _Matched, stamp_s: float, match: LocalMatch) -> Motion:
    """Return the step from the last scan, with what both matches leave open."""
    information = step_information(last.pose, last.information, match.pose, match.information)
    step = last.pose.between(match.pose)
    return Motion(last.stamp_s, stamp_s, step, information, _details(match), is_matched=True)


def _details(match: LocalMatch) -> dict[str, float]:
    residual_m = match.residual_m if math.isfinite(match.residual_m) else -1.0
    return {"share": match.share, "residual_m": residual_m}
