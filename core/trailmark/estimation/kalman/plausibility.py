"""What no robot does and no place on Earth is: estimates that are refused before anything is learned from them."""

from __future__ import annotations

import math

from trailmark.estimates import Fix, Motion, PathOffset
from trailmark.estimation.kalman_config import KalmanConfig

__all__ = ["fix_refusal", "motion_refusal", "offset_refusal"]

#: What is counted, and the reason in words.
Refusal = tuple[str, str]

# Half the way around the Earth.
_FARTHEST_M = 2e7


def motion_refusal(motion: Motion, config: KalmanConfig) -> Refusal | None:
    """Return why a motion cannot be; None if it can."""
    dt_s = motion.stamp_s - motion.since_s
    if not math.isfinite(motion.since_s):
        return "stamp", f"the motion begins at {motion.since_s} s"
    if dt_s > config.time_jump_s:
        return "time_jump", f"a motion over {dt_s:g} s: the clock jumped"
    speed_mps = math.hypot(motion.pose_since_now.x, motion.pose_since_now.y) / dt_s
    if speed_mps > config.max_speed_mps:
        return "too_fast", f"a motion of {speed_mps:.3g} m/s: see max_speed_mps"
    return None


def fix_refusal(fix: Fix) -> Refusal | None:
    """Return why an absolute pose cannot be; None if it can."""
    x_m, y_m = fix.pose_map_base.x, fix.pose_map_base.y
    if abs(x_m) <= _FARTHEST_M and abs(y_m) <= _FARTHEST_M:
        return None
    return "too_far", f"({x_m:.3g}, {y_m:.3g}) m is no place on Earth"


def offset_refusal(offset: PathOffset) -> Refusal | None:
    """Return why a path offset cannot be; None if it can."""
    if math.isfinite(offset.station_m + offset.lateral_m + offset.heading_rad):
        return None
    return "not_finite", "the path offset is not finite"
