"""Where the last correction left base in the map: later motion is carried on from there."""

from __future__ import annotations

import math
from dataclasses import replace

from trailmark.estimation.chain import OdomState
from trailmark.estimation.symmetric import ZERO, Sym3, add, congruence, subtract
from trailmark.estimation.unmeasured import NOWHERE, Sym2, directions_above, longest, plus, squared_by_direction, turned
from trailmark.geometry import Pose2
from trailmark.values import quick_dataclass

__all__ = ["PoseAnchor", "anchor_after", "anchor_at"]


@quick_dataclass(frozen=True, slots=True, eq=False)
class PoseAnchor:
    """The pose after the last correction, and what odometry said there: later motion is carried on from here."""

    odom: OdomState
    pose_map_base: Pose2 | None
    excess: Sym3 = ZERO  # covariance in odom's coordinates, less the spread of odometry until here
    is_measured: bool = False
    unmeasured_m: Sym2 = NOWHERE  # of the error at this anchor, what lasts: by direction in odom

    def unmeasured_at(self, odom: OdomState) -> Sym2:
        """Return how far drift may have carried base unseen, by direction in odom [m]."""
        since_m = plus(odom.unmeasured_m, self.odom.unmeasured_m, -1.0)
        return plus(self.unmeasured_m, since_m, 1.0)

    def pose_at(self, odom: OdomState) -> tuple[Pose2, Sym3] | None:
        """Return pose and covariance where odometry says something else; None while the pose is unknown."""
        if self.pose_map_base is None:
            return None
        turn = self.pose_map_base.theta - self.odom.pose_odom_base.theta
        cos, sin = math.cos(turn), math.sin(turn)
        x, y = odom.pose_odom_base.x, odom.pose_odom_base.y
        spread = add(self.excess, odom.spread)
        if odom.unmeasured_m is not NOWHERE:
            spread = add(spread, squared_by_direction(self.unmeasured_at(odom)))
        covariance = congruence(spread, cos, sin, -cos * y - sin * x, cos * x - sin * y)
        return self.pose_map_base.moved_as(self.odom.pose_odom_base, odom.pose_odom_base), covariance


def anchor_after(before: PoseAnchor, odom: OdomState, pose: Pose2, covariance: Sym3) -> PoseAnchor:
    """Return the anchor after a correction: of the error that lasts, what the correction leaves room for."""
    anchor = anchor_at(odom, pose, covariance, is_measured=True)
    unmeasured_m = before.unmeasured_at(odom)
    most_m = longest(unmeasured_m)
    if most_m <= 0.0:
        return anchor
    turn = odom.pose_odom_base.theta - pose.theta
    xx, xy, yy = turned((covariance[0], covariance[1], covariance[3]), turn)
    along = directions_above(unmeasured_m, 0.5 * most_m)
    across_m2 = along[0] * yy - 2.0 * along[1] * xy + along[2] * xx  # over the determinant: the information along
    left_m2 = max(xx * yy - xy * xy, 0.0) / across_m2 if across_m2 > 0.0 else 0.0
    kept_m = plus(NOWHERE, unmeasured_m, min(1.0, math.sqrt(left_m2) / most_m))
    return replace(anchor, excess=subtract(anchor.excess, squared_by_direction(kept_m)), unmeasured_m=kept_m)


def anchor_at(odom: OdomState, pose: Pose2, covariance: Sym3, is_measured: bool) -> PoseAnchor:
    """Return the anchor of a pose in the map, with its covariance there, at the place that odometry gives."""
    turn = pose.theta - odom.pose_odom_base.theta
    cos, sin = math.cos(turn), math.sin(turn)
    x, y = odom.pose_odom_base.x, odom.pose_odom_base.y
    spread = congruence(covariance, cos, -sin, y, -x)  # the inverse of what `PoseAnchor.pose_at` does
    return PoseAnchor(odom, pose, excess=subtract(spread, odom.spread), is_measured=is_measured)
