"""The localizer ``scan_odometry``: motion from a planar laser alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import ShapeError
from trailmark.estimates import Belief, Estimate, Lost, Motion
from trailmark.frames import Frame, Scan
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, Session
from trailmark_laser_maps.odometry.config import ScanOdometryConfig
from trailmark_laser_maps.odometry.matching import LocalMap, LocalMatch
from trailmark_laser_maps.uncertainty import step_information

__all__ = ["ScanOdometry"]

_MIN_POINTS = 20
#: A match this good needs no other guesses; else turns of base from which it is tried again [deg].
_GOOD_SHARE, _TURNS_DEG = 0.85, (-24.0, -16.0, -8.0, 8.0, 16.0, 24.0)
#: Half of a scan nearer than this is left out: the next one that sees more is matched to the same scans [m].
_COVERED_M = 0.4
#: The first scan lies on its local map by definition.
_EXACT = 1e12 * np.eye(3)


@dataclass(frozen=True, slots=True, eq=False)
class _Matched:
    """The last scan: when, where in the local map and how surely, where the belief's odometry was, the step to it."""

    stamp_s: float
    pose: Pose2
    pose_odom_base: Pose2
    step: Pose2
    information: Floats


class ScanOdometry(Localizer):
    """Matches each scan to the last ones, point to line; says `Motion` with no information where no wall tells it.

    The search begins where the belief expects the robot, and where the last step would lead it again.
    """

    config: ScanOdometryConfig

    def start(self, session: Session) -> None:
        """Forget all scans."""
        self._pose_base_laser = session.sensors[self.config.laser].pose_base_sensor.planar()
        self._map = LocalMap(self.config.keep_scans)
        self._last: _Matched | None = None
        self._keyscan = Pose2()

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return the motion since the last scan, or `Lost` where the scan does not match."""
        if not isinstance(frame.payload, Scan):
            raise ShapeError(f"scan_odometry takes scans, but {frame.sensor!r} gave {type(frame.payload).__name__}")
        points = self._points(frame.payload)
        if len(points) < _MIN_POINTS:
            return [Lost(frame.stamp_s, f"only {len(points)} returns")]
        if self._is_covered(points):
            return [
                Lost(frame.stamp_s, f"half of the returns are nearer than {_COVERED_M} m: something covers the laser")
            ]
        last = self._last
        if last is None or frame.stamp_s <= last.stamp_s:
            self._begin(frame.stamp_s, points, belief)
            return []
        match = self._match(last, points, belief)
        if match.share < self.config.min_share:
            self._begin(frame.stamp_s, points, belief)
            return [Lost(frame.stamp_s, f"only {match.share:.0%} of the scan lies on those before it", _details(match))]
        motion = _motion(last, frame.stamp_s, match)
        self._last = _Matched(
            frame.stamp_s, match.pose, belief.pose_odom_base, motion.pose_since_now, match.information
        )
        self._add_when_new(match, points)
        return [motion]

    def _is_covered(self, points: Floats) -> bool:
        """Whether hardly more is seen than something that stands close by, and may walk along."""
        offsets = points - (self._pose_base_laser.x, self._pose_base_laser.y)
        return float(np.median(np.hypot(offsets[:, 0], offsets[:, 1]))) < _COVERED_M

    def _begin(self, stamp_s: float, points: Floats, belief: Belief) -> None:
        """Begin a local map with this scan."""
        self._map = LocalMap(self.config.keep_scans)
        self._map.add(Pose2(), points)
        self._keyscan = Pose2()
        self._last = _Matched(stamp_s, Pose2(), belief.pose_odom_base, Pose2(), _EXACT)

    def _match(self, last: _Matched, points: Floats, belief: Belief) -> LocalMatch:
        rays = points[np.linspace(0, len(points) - 1, min(self.config.n_rays, len(points))).astype(int)]
        expected = last.pose @ last.pose_odom_base.between(belief.pose_odom_base)
        match = self._map.match(rays, [expected, last.pose @ last.step], self.config.sigma_m)
        if match.share >= _GOOD_SHARE:
            return match
        turned = [expected @ Pose2(0.0, 0.0, math.radians(turn)) for turn in _TURNS_DEG]
        return self._map.match(rays, [match.pose, *turned], self.config.sigma_m)

    def _add_when_new(self, match: LocalMatch, points: Floats) -> None:
        way = self._keyscan.between(match.pose)
        is_far = math.hypot(way.x, way.y) >= self.config.keyscan_m
        if is_far or abs(way.theta) >= math.radians(self.config.keyscan_deg) or match.share < _GOOD_SHARE:
            self._map.add(match.pose, points)
            self._keyscan = match.pose

    def _points(self, scan: Scan) -> Floats:
        return self._pose_base_laser @ scan.points_within(self.config.max_range_m)


def _motion(last: _Matched, stamp_s: float, match: LocalMatch) -> Motion:
    """Return the step from the last scan, with what both matches leave open."""
    information = step_information(last.pose, last.information, match.pose, match.information)
    return Motion(last.stamp_s, stamp_s, last.pose.between(match.pose), information, _details(match))


def _details(match: LocalMatch) -> dict[str, float]:
    residual_m = match.residual_m if math.isfinite(match.residual_m) else -1.0
    return {"share": match.share, "residual_m": residual_m}
