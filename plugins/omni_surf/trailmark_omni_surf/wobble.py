"""How answers wander about the motion between them: what a wrong landmark does as the robot passes it."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Pose2, wrap_angles

__all__ = ["Wobble"]

#: So long answers count, and so many there must be [s].
_SPAN_S, _FEWEST = 6.0, 4


class Wobble:
    """The answers of late, each with where odometry was.

    A wrong landmark drags the pose by another amount from each place, which no error in one picture tells. Odometry
    does. What changes steadily is left out, for that may as well be the odometry: wheels that slip, scale or stand. Nor
    must a fix widen by it, or nobody could find out who is wrong.
    """

    def __init__(self) -> None:
        self._rows: deque[tuple[float, float, float, float]] = deque()  # stamp, and odometry's origin in the map

    def clear(self) -> None:
        """Forget all: the robot is elsewhere."""
        self._rows.clear()

    def expected(self, stamp_s: float, pose_odom_base: Pose2) -> Pose2 | None:
        """Return where base is by the last answer and the motion since; None without one of late."""
        if not self._rows or self._rows[-1][0] < stamp_s - _SPAN_S:
            return None
        return Pose2(*self._rows[-1][1:]) @ pose_odom_base

    def add(self, stamp_s: float, pose_map_base: Pose2, pose_odom_base: Pose2) -> Floats | None:
        """Take an answer; return by how much those before it, carried along, scatter about it.

        Parameters
        ----------
        stamp_s : float
            Its stamp [s].
        pose_map_base, pose_odom_base : Pose2
            What it says, and what odometry says.

        Returns
        -------
        (3, 3) float64 or None
            Mean square of x, y and heading in the map about the answer, without what changes steadily with time
            [m, m, rad]; None where too few were before it.
        """
        origin = pose_map_base @ pose_odom_base.inverse()
        rows = self._rows
        while rows and rows[0][0] < stamp_s - _SPAN_S:
            rows.popleft()
        before = np.array(rows)
        rows.append((stamp_s, origin.x, origin.y, origin.theta))
        if len(before) < _FEWEST:
            return None
        ago_s, x, y, theta = (before - (stamp_s, 0.0, 0.0, 0.0)).T
        cos, sin = np.cos(theta), np.sin(theta)
        off = np.column_stack(
            [
                x + cos * pose_odom_base.x - sin * pose_odom_base.y - pose_map_base.x,
                y + sin * pose_odom_base.x + cos * pose_odom_base.y - pose_map_base.y,
                wrap_angles(theta - math.remainder(origin.theta, math.tau)),
            ]
        )
        off -= np.outer(ago_s, ago_s @ off / (ago_s @ ago_s))
        return np.asarray(off.T @ off / len(off))
