"""What a calibration changes in a config: whole lines, with everything that stood there."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from typing import Any

from trailmark.arrays import Bools, Floats
from trailmark.config import MotionCorrection, RunConfig
from trailmark.frames import SensorInfo
from trailmark_calibration.model import DELAY, TURN, TURN_PER_M, WAY, YAW, MotionPairs, X, Y

__all__ = ["delay_lines", "in_flow_style", "mounting_lines", "odometry_lines", "wheels_in_words"]

_PLAIN = re.compile(r"[A-Za-z_/.][\w/.@-]*")
_WORDS = {"true", "false", "null", "yes", "no", "on", "off", "nan", "inf", ".nan", ".inf"}


def odometry_lines(config: RunConfig, name: str, pairs: MotionPairs, numbers: Floats) -> list[str]:
    """Return the line of a localizer with the correction of its motions, on top of the one that it had.

    Parameters
    ----------
    config : RunConfig
        The config.
    name : str
        Of the localizer.
    pairs : MotionPairs
        Turns numbers into a correction.
    numbers : (8,) float64
        What was found, and what was known of the rest.
    """
    known = config.localizers[name].options.correct or MotionCorrection()
    matrix = pairs.matrix(numbers) @ known.matrix()
    correction = {
        "way": round(float(matrix[0, 0]), 5),
        "turn": round(float(matrix[2, 2]), 5),
        "turn_deg_per_m": round(math.degrees(float(matrix[2, 0])), 4),
        "way_m_per_rad": round(float(matrix[0, 2]), 5),
    }
    neutral = MotionCorrection().model_dump()
    told = {key: value for key, value in correction.items() if value != neutral[key]}
    return [
        "localizers:",
        f"  {name}: {in_flow_style(_read_part(config, 'localizers', name) | {'correct': told})}",
    ]


def mounting_lines(config: RunConfig, sensor: SensorInfo, numbers: Floats, is_told: Bools) -> list[str]:
    """Return the line of a sensor with its whole mounting: what was found, and what was known of the rest.

    Parameters
    ----------
    config : RunConfig
        The config.
    sensor : SensorInfo
        As the run knew it.
    numbers : (8,) float64
        What was found.
    is_told : (8,) bool
        Which of them the drive tells.
    """
    known = sensor.pose_base_sensor
    place = {
        "x": numbers[X] if is_told[X] else known.x,
        "y": numbers[Y] if is_told[Y] else known.y,
        "z": known.z,
        "roll_deg": math.degrees(known.roll),
        "pitch_deg": math.degrees(known.pitch),
        "yaw_deg": math.degrees(math.remainder(numbers[YAW], 2.0 * math.pi) if is_told[YAW] else known.yaw),
    }
    mounting = {key: rounded for key, value in place.items() if (rounded := round(float(value), 4)) or key == "yaw_deg"}
    line = in_flow_style(_read_part(config, "sensors", sensor.name) | {"mounting": mounting})
    return ["sensors:", f"  {sensor.name}: {line}"]


def delay_lines(config: RunConfig, source: str, numbers: Floats) -> list[str]:
    """Return the line of a source with the offset of its stamps, on top of the one that it had."""
    offset_s = config.sources[source].config.time_offset_s + float(numbers[DELAY])
    line = in_flow_style(_read_part(config, "sources", source) | {"time_offset_s": round(offset_s, 4) + 0.0})
    return ["sources:", f"  {source}: {line}"]


def wheels_in_words(pairs: MotionPairs, numbers: Floats) -> list[str]:
    """Return two radii and the track of differential wheels, for the robot's own driver; empty without a track."""
    if pairs.track_m is None:
        return []
    track_m = pairs.track_m * float(numbers[WAY] / numbers[TURN])
    half = float(numbers[TURN_PER_M]) * track_m / 2.0
    left, right = float(numbers[WAY]) - half, float(numbers[WAY]) + half
    return [f"for its own driver: left wheel x {left:.5f}, right wheel x {right:.5f}, track {abs(track_m):.5f} m"]


def _read_part(config: RunConfig, section: str, name: str) -> dict[str, Any]:
    value = (config.written.data.get(section) or {}).get(name) or {}
    return {"plugin": value} if isinstance(value, str) else dict(value)


def in_flow_style(value: Any) -> str:
    """Return plain data in one line of YAML."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{in_flow_style(key)}: {in_flow_style(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(in_flow_style(item) for item in value) + "]"
    if isinstance(value, str) and _PLAIN.fullmatch(value) and value.lower() not in _WORDS:
        return value
    if isinstance(value, float) and math.isfinite(value):
        return f"{value:.10g}"
    return json.dumps(value, ensure_ascii=False)
