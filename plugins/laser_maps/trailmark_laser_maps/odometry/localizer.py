"""The localizer ``scan_odometry``: motion from a planar laser alone."""

from __future__ import annotations

import math
from collections.abc import Sequence

from trailmark.errors import ShapeError
from trailmark.estimates import Belief, Estimate
from trailmark.estimation.scan_following import FollowingRules, ScanFollower
from trailmark.frames import Frame, Scan
from trailmark.interfaces import Localizer, Session
from trailmark_laser_maps.odometry.config import ScanOdometryConfig

__all__ = ["ScanOdometry"]


class ScanOdometry(Localizer):
    """Matches each scan to the last ones, point to line; says `Motion` with no information where no wall tells it.

    The search begins where the belief expects the robot, and where the last step would lead it again.
    """

    config: ScanOdometryConfig

    def start(self, session: Session) -> None:
        """Forget all scans."""
        config = self.config
        self._pose_base_laser = session.sensors[config.laser].pose_base_sensor.planar()
        rules = FollowingRules(
            keep_scans=config.keep_scans,
            keyscan_m=config.keyscan_m,
            keyscan_rad=math.radians(config.keyscan_deg),
            n_rays=config.n_rays,
            min_share=config.min_share,
            sigma_m=config.sigma_m,
        )
        self._follower = ScanFollower(self._pose_base_laser, rules)

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return the motion since the last scan, or `Lost` where the scan does not match."""
        if not isinstance(frame.payload, Scan):
            raise ShapeError(f"scan_odometry takes scans, but {frame.sensor!r} gave {type(frame.payload).__name__}")
        points = self._pose_base_laser @ frame.payload.points_within(self.config.max_range_m)
        answer = self._follower.follow(frame.stamp_s, points, belief.pose_odom_base).answer
        return [] if answer is None else [answer]
