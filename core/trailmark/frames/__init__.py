"""What a sensor gives: frames with one payload each, and what is known about the sensor."""

from typing import TYPE_CHECKING

from trailmark.frames.payloads import (
    RGBD,
    Frame,
    Image,
    Imu,
    Odometry,
    Payload,
    Record,
    Scalar,
    Scan,
)
from trailmark.frames.sensors import PAYLOAD_KINDS, SensorInfo, SensorOrigin, payload_kind
from trailmark.lazy import lazy_names

if TYPE_CHECKING:
    from trailmark.frames.calibration import Arrays, Calibration, DepthCamera, GroundPlane, Omni, Pinhole
    from trailmark.frames.outlines import Outlines

__all__ = [
    "PAYLOAD_KINDS",
    "RGBD",
    "Arrays",
    "Calibration",
    "DepthCamera",
    "Frame",
    "GroundPlane",
    "Image",
    "Imu",
    "Odometry",
    "Omni",
    "Outlines",
    "Payload",
    "Pinhole",
    "Record",
    "Scalar",
    "Scan",
    "SensorInfo",
    "SensorOrigin",
    "payload_kind",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "calibration": ["Arrays", "Calibration", "DepthCamera", "GroundPlane", "Omni", "Pinhole"],
        "outlines": ["Outlines"],
    },
)
