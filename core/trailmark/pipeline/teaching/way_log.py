"""What teaching notes of the way, for straightening it at the end: beliefs along it, and how certain each was."""

from __future__ import annotations

import math

import numpy as np

from trailmark.estimates import Belief
from trailmark.geometry import Pose2
from trailmark.interfaces import LocalizerMap
from trailmark.paths import Keyframe

__all__ = ["COVARIANCE", "FIXED", "WAY_LOG", "WayLog"]

#: Under this owner a path store keeps the log; no localizer is called so.
WAY_LOG = "(way)"
#: Covariance of the belief, (3, 3), empty where none was estimated; whether anything had ever fixed it in the map.
COVARIANCE, FIXED = "covariance", "fixed"

_SPACING_M, _SPACING_RAD = 0.5, math.radians(20.0)


class WayLog:
    """Notes the belief every half metre and every 20 degrees.

    Parameters
    ----------
    log : LocalizerMap
        Where it is kept; what is noted is committed with the next waypoint.
    """

    def __init__(self, log: LocalizerMap) -> None:
        self._log = log
        self._last: Pose2 | None = None

    def note(self, belief: Belief, station_m: float) -> None:
        """Note a belief, if the robot has come far enough, or turned, since the last."""
        if belief.pose_map_base is None:
            return
        if self._last is not None:
            since = self._last.between(belief.pose_odom_base)
            if math.hypot(since.x, since.y) < _SPACING_M and abs(since.theta) < _SPACING_RAD:
                return
        self._last = belief.pose_odom_base
        covariance = np.zeros((0, 0)) if belief.covariance is None else belief.covariance
        arrays = {COVARIANCE: covariance, FIXED: np.array(math.isfinite(belief.fix_age_m))}
        self._log.add(Keyframe(station_m, belief.stamp_s, belief.pose_map_base, arrays))
