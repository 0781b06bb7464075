"""Recordings of ROS with every kind of message, and messages that are wrong in what they say."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from tests.datasets.conftest import Recording

from trailmark.geometry import Pose3

__all__ = ["good_recording", "spoil_messages"]

Rng = np.random.Generator

_NUMBERS = (0.0, -1.0, math.nan, math.inf, -math.inf, 1e308, 1e-320, 1e18, 2.0**63)
_COUNTS = (0, 1, 2, 65535, 2**31 - 1)
_WORDS = (
    "",
    "/",
    "//",
    "mono8",
    "rgb8",
    "32FC1",
    "yuv422",
    "compressedDepth",
    "\u00e4\u00f6",
    "a" * 4000,
    "..",
    "\x1b[2J",
    "%s%n",
)


def good_recording(kind: str, pictures: list[np.ndarray]) -> Recording:
    """Return a drive of pictures, scans, odometry, inertial readings, poses, satellites and transforms."""
    record = Recording(kind)
    record.add("/tf_static", record.mounting("base_link", "camera", Pose3(x=0.1, z=0.3)), 1.0)
    record.add("/tf_static", record.mounting("base_link", "laser", Pose3(x=0.2)), 1.0)
    for index, picture in enumerate(pictures):
        at_s = 100.0 + 0.1 * index
        record.add("/cam/image_raw", record.image(at_s, picture, "mono8", frame_id="camera"), at_s)
        record.add("/cam/camera_info", record.info(60.0), at_s)
        record.add("/scan", record.scan(at_s, [1.0, 1.5, 2.0, 2.5, 1.0], frame_id="laser"), at_s)
        record.add("/odom", record.odometry(at_s, 0.02 * index, 0.0, 0.0), at_s)
        record.add("/imu", record.imu(at_s), at_s)
        record.add("/pose", record.pose(at_s, 0.02 * index, 0.0, 0.0), at_s)
        record.add("/fix", record.satellites(at_s, 45.0 + 1e-6 * index, 7.0), at_s)
        record.add("/tf", record.transform(at_s, "odom", "base_link", 0.02 * index, 0.0), at_s)
        record.add("/chatter", record.text("hello"), at_s)
    return record


def spoil_messages(record: Recording, rng: Rng) -> None:
    """Put wrong values into fields of some messages, lose, double and swap messages; in place."""
    for _ in range(int(rng.integers(1, 8))):
        at = int(rng.integers(len(record.messages)))
        match int(rng.integers(8)):
            case 0:
                del record.messages[at]
            case 1:
                record.messages.insert(int(rng.integers(len(record.messages))), record.messages[at])
            case 2:
                topic, _, message = record.messages[at]
                record.messages[at] = (topic, abs(float(rng.choice([0.0, 1.0, 2.0**31, 1e9]))), message)
            case _:
                _spoil_field(record.messages[at][2], rng)
        if not record.messages:
            return


def _spoil_field(message: Any, rng: Rng) -> None:
    """Go down to a random field and set it to something else of its own type."""
    while True:
        names = [name for name in message.__dataclass_fields__ if not name.startswith("_")]
        name = str(rng.choice(names))
        value = getattr(message, name)
        if isinstance(value, list) and value:
            value = value[int(rng.integers(len(value)))]
        if not hasattr(value, "__dataclass_fields__"):
            break
        message = value
    object.__setattr__(message, name, _other(value, rng))


def _other(value: Any, rng: Rng) -> Any:
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return int(rng.choice(_COUNTS)) & (0xFF if value < 2 and rng.random() < 0.5 else 0x7FFFFFFF)
    if isinstance(value, float):
        return float(rng.choice(_NUMBERS))
    if isinstance(value, str):
        return str(rng.choice(_WORDS))
    if isinstance(value, np.ndarray) and value.size and value.dtype.kind == "f":
        spoilt = value.copy()
        spoilt.flat[int(rng.integers(value.size))] = rng.choice(_NUMBERS[:5])
        return spoilt
    if isinstance(value, np.ndarray):
        return value[: int(rng.integers(value.size + 1))] if value.ndim == 1 and value.size > 36 else value
    return value
