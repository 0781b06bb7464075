"""What sinks for viewers share: poses in space, pictures packed, estimates and beliefs as plain numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.estimates import Belief, Estimate, Fix, Lost, Motion, PathOffset
from trailmark.geometry import Pose2, Pose3

__all__ = ["belief_numbers", "estimate_numbers", "jpeg", "plain", "quaternion_xyzw", "to_space"]


def to_space(pose: Pose2) -> Pose3:
    """Return a pose on the floor as one in space."""
    return Pose3(pose.x, pose.y, 0.0, 0.0, 0.0, pose.theta)


def quaternion_xyzw(pose: Pose3) -> tuple[float, float, float, float]:
    """Return the quaternion (x, y, z, w) of roll, pitch and yaw in the order of REP-103."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a / 2), math.sin(a / 2)) for a in (pose.roll, pose.pitch, pose.yaw))
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def jpeg(pixels: npt.NDArray[np.uint8], quality: int) -> bytes:
    """Return a grey or BGR picture as JPEG."""
    import cv2

    _, data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return data.tobytes()


def belief_numbers(belief: Belief) -> dict[str, Any]:
    """Return what is believed as plain numbers; None where nothing is known."""
    on_path = belief.on_path
    return {
        "pose_map_base": plain(belief.pose_map_base),
        "forward_mps": belief.twist.forward_mps,
        "yaw_radps": belief.twist.yaw_radps,
        "travelled_m": belief.travelled_m,
        "fix_age_m": plain(belief.fix_age_m),
        "motion_age_s": plain(belief.motion_age_s),
        "on_path": None if on_path is None else [on_path.station_m, on_path.lateral_m, on_path.heading_rad],
    }


def estimate_numbers(estimate: Estimate) -> dict[str, Any]:
    """Return what an estimate says, as plain numbers."""
    match estimate:
        case Motion():
            return {"since_s": estimate.since_s, "pose_since_now": plain(estimate.pose_since_now)}
        case Fix():
            return {"pose_map_base": plain(estimate.pose_map_base)}
        case PathOffset():
            return {"on_path": [estimate.station_m, estimate.lateral_m, estimate.heading_rad]}
        case Lost():
            return {"lost": estimate.reason}


def plain(value: Any) -> Any:
    """Return a value as JSON has it, which knows no infinity."""
    if isinstance(value, Pose2):
        return [value.x, value.y, value.theta]
    if isinstance(value, np.ndarray):
        return [plain(item) for item in value.tolist()]
    if isinstance(value, list):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
