"""What is believed of a sensor and is not so; its readings stay as they are."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from pydantic import Field

from trailmark.config import PluginConfig
from trailmark.deprecation import deprecated_name
from trailmark.frames import DepthCamera, GroundPlane, Pinhole, SensorInfo
from trailmark.geometry import Pose3

__all__ = ["WrongCalibration", "idle_keys", "with_wrong_calibration"]


class WrongCalibration(PluginConfig):
    """What is believed of a sensor and is not so; its readings stay as they are."""

    scale: float = Field(default=1.0, gt=0)
    """Metres per pixel of a ground camera, focal lengths of others: times this."""
    x_m: float = 0.0
    """The sensor is believed to sit so much further forward [m]."""
    y_m: float = 0.0
    """Further to the left [m]."""
    yaw_deg: float = 0.0
    """Turned by so much more, counter-clockwise [deg]."""
    pitch_deg: float = 0.0
    """Nodding by so much more [deg]."""


def with_wrong_calibration(info: SensorInfo, wrong: WrongCalibration) -> SensorInfo:
    """Return a sensor with the calibration that the fault gives it."""
    offset = Pose3(wrong.x_m, wrong.y_m, 0.0, 0.0, math.radians(wrong.pitch_deg), math.radians(wrong.yaw_deg))
    mounted = info.pose_base_sensor
    turned = Pose3(0.0, 0.0, 0.0, mounted.roll, mounted.pitch, mounted.yaw) @ replace(offset, x=0.0, y=0.0)
    pose = Pose3(mounted.x + offset.x, mounted.y + offset.y, mounted.z, turned.roll, turned.pitch, turned.yaw)
    return replace(info, pose_base_sensor=pose, calibration=_scale_calibration(info.calibration, wrong.scale))


def idle_keys(info: SensorInfo, wrong: WrongCalibration) -> dict[str, str]:
    """Return the keys that change nothing of a sensor, and what they do befall."""
    idle: dict[str, str] = {}
    if wrong.scale != 1.0 and _scale_calibration(info.calibration, wrong.scale) is info.calibration:
        idle["wrong.scale"] = "cameras with metres per pixel or focal lengths"
    if info.kind == "odometry":  # its poses are those of base, wherever it sits
        used = [key for key in ("x_m", "y_m", "yaw_deg", "pitch_deg") if getattr(wrong, key)]
        idle |= {f"wrong.{key}": "sensors that see from where they sit" for key in used}
    return idle


def _scale_calibration(calibration: Any, scale: float) -> Any:
    if scale == 1.0:
        return calibration
    match calibration:
        case GroundPlane(metres_per_pixel=(along_u, along_v)):
            return replace(calibration, metres_per_pixel=(scale * along_u, scale * along_v))
        case Pinhole():
            return replace(calibration, fx=scale * calibration.fx, fy=scale * calibration.fy)
        case DepthCamera():
            depth = None if calibration.depth is None else _scale_calibration(calibration.depth, scale)
            return replace(calibration, colour=_scale_calibration(calibration.colour, scale), depth=depth)
    return calibration


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {"misjudged": with_wrong_calibration})
