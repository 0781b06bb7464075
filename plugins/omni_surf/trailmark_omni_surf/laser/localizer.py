"""The localizer ``laser_icp``: remembers scans while taught, matches scans to their map afterwards."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import ShapeError, StoreError
from trailmark.estimates import Belief, Estimate, Fix, Lost
from trailmark.estimation.scan_following import FollowedScan, FollowingRules, ScanFollower
from trailmark.frames import Frame, Scan
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, Session
from trailmark.paths import Keyframe
from trailmark_omni_surf.laser.anywhere import AnywhereMatcher, AnywhereSearch, least_share
from trailmark_omni_surf.laser.config import LaserIcpConfig
from trailmark_omni_surf.laser.joining import ScanJoiner
from trailmark_omni_surf.laser.matching import ScanMatch, SearchWindow, match_scan
from trailmark_omni_surf.laser.scan_map import ScanMap
from trailmark_omni_surf.spacing import KeyframeSpacing

__all__ = ["LaserIcp"]

_MIN_POINTS = 20  # fewer returns say nothing about a place
_MAP = "map"


class LaserIcp(Localizer):
    """Matches planar scans to the taught map about the belief, or anywhere in it while the pose is unknown."""

    motion_is_spare = True  # while it teaches
    relates_keyframes = True

    config: LaserIcpConfig

    def start(self, session: Session) -> None:
        """Load the map, and compile the kernels on a scan of a small room."""
        self._mode, self._localizer_map = session.mode, session.map
        self._pose_base_laser = session.sensors[self.config.laser].pose_base_sensor.planar()
        self._window = SearchWindow(span_m=self.config.span_m, span_rad=math.radians(self.config.span_deg))
        self._follower = ScanFollower(self._pose_base_laser, FollowingRules(min_share=self.config.min_inlier_share))
        self._spacing = KeyframeSpacing(self.config.keyframe_m, math.radians(self.config.keyframe_deg))
        _warm_up()
        self._map = self._load_map() if self._mode != "teach" else None
        self._search: AnywhereSearch | None = None
        self._scans: list[Floats] | None = None

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return a `Fix`, or `Lost` when the scan does not fit or fits in two places; see `match_scan`.

        In teach, a `Motion` since the last scan, or `Lost` when it does not fit those before it.
        """
        if not isinstance(frame.payload, Scan):
            raise ShapeError(f"laser_icp takes scans, but sensor {frame.sensor!r} gave {type(frame.payload).__name__}")
        points_base = self._points(frame.payload)
        if self._mode == "teach":
            return self._teach(frame, points_base, belief)
        if self._map is None:
            return [Lost(frame.stamp_s, "no map: nothing was taught here")]
        if belief.pose_map_base is None:
            return [self._find(self._map, frame.stamp_s, points_base, belief.pose_odom_base)]
        self._search = None
        return [self._localize(self._map, frame.stamp_s, points_base, belief.pose_map_base)]

    def finish(self) -> None:
        """Build the map from the remembered scans and save it."""
        if self._localizer_map is None:
            return
        keyframes = self._localizer_map.keyframes()
        if keyframes:
            scans = [keyframe.arrays["points"].astype(np.float64) for keyframe in keyframes]
            poses = [keyframe.pose_map_base for keyframe in keyframes]
            scan_map = ScanMap.from_scans(scans, poses, min_hits=self.config.min_hits)
            self._localizer_map.save(_MAP, {"points": scan_map.points, "normals": scan_map.normals})

    def relate(self, known: Mapping[int, Pose2], keyframe: int, guess: Pose2, covariance: Floats) -> Fix | Lost:
        """Return where a remembered scan lies on others, or `Lost`; see `Localizer.relate`."""
        if self._scans is None:
            keyframes = self._localizer_map.keyframes() if self._localizer_map is not None else ()
            self._scans = [one.arrays["points"].astype(np.float64) for one in keyframes]
        if len(self._scans[keyframe]) < _MIN_POINTS:
            return Lost(0.0, f"only {len(self._scans[keyframe])} returns")
        joiner = ScanJoiner(self.config.min_inlier_share, self.config.ambiguity_margin_m)
        return joiner.place(self._scans, known, keyframe, guess, covariance)

    def _points(self, scan: Scan) -> Floats:
        return self._pose_base_laser @ scan.points_within(self.config.max_range_m)

    def _load_map(self) -> ScanMap | None:
        saved = self._localizer_map.load(_MAP) if self._localizer_map is not None else None
        if saved is None:
            return None
        try:
            return ScanMap.from_points(saved["points"], saved["normals"])
        except KeyError as error:
            raise StoreError(f"the laser map in the store has no array {error}: teach the place again") from error

    def _teach(self, frame: Frame, points_base: Floats, belief: Belief) -> Sequence[Estimate]:
        """Return the motion since the last scan, and add the scan to the map at the pose that it leads to."""
        pose = belief.pose_map_base
        if pose is None or len(points_base) < _MIN_POINTS:
            return ()
        followed = FollowedScan(None)
        if self.config.correct_while_teaching:
            followed = self._follower.follow(frame.stamp_s, points_base, belief.pose_odom_base)
            pose = pose @ followed.correction
        if followed.shows_place and self._spacing.is_new_place(belief.travelled_m, pose):
            self._remember(frame.stamp_s, belief.travelled_m, pose, points_base)
        return () if followed.answer is None else (followed.answer,)

    def _remember(self, stamp_s: float, station_m: float, pose: Pose2, points_base: Floats) -> None:
        self._spacing.add(station_m, pose)
        if self._localizer_map is not None:
            arrays = {"points": points_base.astype(np.float32)}
            self._localizer_map.add(Keyframe(station_m, stamp_s, pose, arrays))

    def _find(self, scan_map: ScanMap, stamp_s: float, points_base: Floats, pose_odom_base: Pose2) -> Estimate:
        """Search the whole taught place while the pose is unknown."""
        if len(points_base) < _MIN_POINTS:
            return Lost(stamp_s, f"only {len(points_base)} returns")
        keyframes = self._localizer_map.keyframes() if self._localizer_map is not None else ()
        if not keyframes:
            return Lost(stamp_s, "no start pose, and no taught poses to look for it at")
        if self._search is None:
            matcher = AnywhereMatcher(scan_map, [keyframe.pose_map_base for keyframe in keyframes])
            least = max(least_share(scan_map, keyframes), self.config.min_inlier_share)
            self._search = AnywhereSearch(matcher, least)
        if not self._search.is_new(pose_odom_base):
            return Lost(stamp_s, "no pose stands out yet in the taught place, and the robot stands")
        match, is_believed = self._search.update(points_base, pose_odom_base, to_line=self.config.error == "line")
        answer = self._judge(match, stamp_s)
        if isinstance(answer, Fix) and not is_believed:
            return Lost(stamp_s, "no pose stands out yet in the taught place", answer.details)
        return answer

    def _localize(self, scan_map: ScanMap, stamp_s: float, points_base: Floats, guess: Pose2) -> Estimate:
        if len(points_base) < _MIN_POINTS:
            return Lost(stamp_s, f"only {len(points_base)} returns")
        match = match_scan(scan_map, points_base, guess, self._window, to_line=self.config.error == "line")
        return self._judge(match, stamp_s)

    def _judge(self, match: ScanMatch, stamp_s: float) -> Estimate:
        details = {
            "inlier_share": match.inlier_share,
            "residual_m": match.residual_m,
            "cost_m": match.cost_m,
        }
        if match.inlier_share < self.config.min_inlier_share:
            return Lost(stamp_s, f"the scan does not fit the map ({match.inlier_share:.0%} of its points do)", details)
        if match.runner_up_cost_m - match.cost_m < self.config.ambiguity_margin_m:
            return Lost(stamp_s, "the scan fits the map in two places", details)
        return Fix(stamp_s, match.pose_map_base, match.information, details)


def _warm_up() -> None:
    """Compile, or load from the cache, every kernel that a match needs."""
    wall = np.linspace(-1.0, 1.0, 40)
    room = np.concatenate([np.stack([wall, np.full(40, side)], axis=1) for side in (-1.0, 1.0)])
    match_scan(ScanMap.from_scans([room], [Pose2()]), room, Pose2(), SearchWindow(span_m=0.2, span_rad=0.07))
