"""What each localizer said of the last seconds, as the search for clock offsets needs it."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Fix, Motion

__all__ = ["FARTHEST_S", "HEADING", "POSITION_M2", "TURN_RAD2", "WAY", "WINDOW_S", "RecentPoses"]

#: What is compared, and by how much stamps are shifted at most [s].
WINDOW_S, FARTHEST_S = 12.0, 0.6
#: Columns of the table.
HEADING, WAY, POSITION_M2, TURN_RAD2 = 3, 4, 5, 6
_SAME_STAMP_S = 1e-6
_LEAST_INFORMATION = 1e-3


class RecentPoses:
    """What one localizer said of the last seconds: rows of stamp, x, y, heading, way and variances.

    The variances are of position and heading. Of motions all are sums since the row before the first, of fixes the
    poses themselves, without a way.
    """

    def __init__(self, of_motion: bool) -> None:
        self.of_motion = of_motion
        self._rows: deque[tuple[float, ...]] = deque()

    def table(self) -> Floats:
        """Return the rows, (N, 7)."""
        return np.array(self._rows).reshape(-1, 7)

    def clear(self) -> None:
        """Forget all."""
        self._rows.clear()

    def add(self, estimate: Motion | Fix) -> None:
        """Add a motion or a fix; what does not begin where the last motion ended begins anew."""
        if isinstance(estimate, Motion):
            self._add_motion(estimate)
        elif not self._rows or estimate.stamp_s > self._rows[-1][0]:
            pose = estimate.pose_map_base
            self._rows.append((estimate.stamp_s, pose.x, pose.y, pose.theta, 0.0, *_variances(estimate.information)))
        while self._rows and self._rows[-1][0] - self._rows[0][0] > WINDOW_S + 2.0 * FARTHEST_S:
            self._rows.popleft()

    def _add_motion(self, motion: Motion) -> None:
        rows, step = self._rows, motion.pose_since_now
        if rows and motion.stamp_s <= rows[-1][0]:
            return
        if not rows or abs(motion.since_s - rows[-1][0]) > _SAME_STAMP_S:
            rows.clear()
            rows.append((motion.since_s, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        _, x, y, heading, way_m, position_m2, turn_rad2 = rows[-1]
        added_m2, added_rad2 = _variances(motion.information)
        cos, sin = math.cos(heading), math.sin(heading)
        moved_x, moved_y = x + cos * step.x - sin * step.y, y + sin * step.x + cos * step.y
        sums = moved_x, moved_y, heading + step.theta, way_m + step.x, position_m2 + added_m2, turn_rad2 + added_rad2
        rows.append((motion.stamp_s, *sums))


def _variances(information: Floats) -> tuple[float, float]:
    """Return about how uncertain position and heading are, by the diagonal of the information [m^2, rad^2]."""
    xx, yy, tt = information.diagonal().tolist()
    return 2.0 / max(xx + yy, _LEAST_INFORMATION), 1.0 / max(tt, _LEAST_INFORMATION)
