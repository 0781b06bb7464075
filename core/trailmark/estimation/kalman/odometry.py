"""Odometry as it is published: whatever becomes known later, it never jumps."""

from __future__ import annotations

import math

from trailmark.estimation.kalman.state import OdometryState
from trailmark.geometry import Pose2

__all__ = ["PublishedOdometry"]


class PublishedOdometry:
    """Joins odometry to what was published.

    Motion of a slower localizer, or one that comes late, changes where motion has carried base in the past. The past
    that was published stays, and odometry goes on from it; a prediction ahead of all motion binds nobody.
    """

    def __init__(self) -> None:
        self._pose_odom_raw = Pose2()
        self._more_m = 0.0
        self._last: tuple[float, Pose2, float] | None = None
        self._is_doubtful = False

    @classmethod
    def continue_from(cls, pose: Pose2, travelled_m: float, raw: OdometryState) -> PublishedOdometry:
        """Return odometry that goes on from what was published, wherever `raw` begins."""
        odometry = cls()
        odometry._pose_odom_raw = pose @ raw.pose_odom_base.inverse()
        odometry._more_m = travelled_m - raw.travelled_m
        return odometry

    @property
    def last_s(self) -> float:
        """Newest stamp for which measured odometry was published; ``-inf`` if none [s]."""
        return self._last[0] if self._last else -math.inf

    @property
    def is_doubtful(self) -> bool:
        """Whether motion has changed before `last_s`: `rejoin` is due."""
        return self._is_doubtful

    def note_change(self, since_s: float) -> None:
        """Take note that motion has changed from a stamp on."""
        self._is_doubtful = self._is_doubtful or since_s < self.last_s

    def rejoin(self, raw: OdometryState) -> None:
        """Go on from what was published at `last_s`, where motion now says `raw`."""
        assert self._last is not None
        _, pose, travelled_m = self._last
        self._pose_odom_raw = pose @ raw.pose_odom_base.inverse()
        self._more_m = travelled_m - raw.travelled_m
        self._is_doubtful = False

    def publish(self, raw: OdometryState, stamp_s: float) -> tuple[Pose2, float]:
        """Return the pose in odom and the way travelled, of a state at a stamp."""
        pose, travelled_m = self._pose_odom_raw @ raw.pose_odom_base, raw.travelled_m + self._more_m
        if raw.is_measured and raw.gap_s == 0.0 and stamp_s > self.last_s:
            self._last = stamp_s, pose, travelled_m
        return pose, travelled_m
