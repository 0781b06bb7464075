"""What every frame source's config has."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from trailmark.config.base import PluginConfig
from trailmark.config.files import ExistingFile

__all__ = ["LiveSourceConfig", "Mounting", "SourceConfig"]


class Mounting(PluginConfig):
    """Where a sensor sits on the robot: ``point_base = pose_base_sensor @ point_sensor``."""

    x: float = 0.0
    """Forward [m]."""
    y: float = 0.0
    """To the left [m]."""
    z: float = 0.0
    """Up [m]."""
    roll_deg: float = 0.0
    """Turn about x [deg]."""
    pitch_deg: float = 0.0
    """Turn about y [deg]."""
    yaw_deg: float = 0.0
    """Turn about z [deg]."""


class SourceConfig(PluginConfig):
    """Base of every source's config. All but `on_bad_frame` is the pipeline's work, not the source's."""

    calibration: ExistingFile | dict[str, Any] | None = None
    """Calibration of the source's only sensor: a file, or the numbers themselves."""
    mounting: Mounting | None = None
    """Mounting of the source's only sensor."""
    ground_truth: ExistingFile | None = None
    """TUM file with the true trajectory of base."""
    time_offset_s: float = 0.0
    """Added to every stamp of this source [s]."""
    start_s: float | None = Field(None, ge=0)
    """Skip what comes earlier than this after the first frame [s]."""
    stop_s: float | None = Field(None, gt=0)
    """End this long after the first frame [s]."""
    rename: dict[str, str] = Field(default_factory=dict)
    """New names for the source's sensors: old to new."""
    on_bad_frame: Literal["error", "skip"] = "error"
    """An unreadable frame, a changed size, a stamp that goes back: ends the run, or is counted and skipped."""
    perturb: dict[str, Any] | None = None
    """Faults of its sensors, on purpose: keys of the fault `basic` (noise, blur, lost frames, a wrong calibration ...),
    names of other faults with their keys, and `sensors`: which sensors they befall, default: all that they can."""


class LiveSourceConfig(SourceConfig):
    """Base of the config of sources whose frames come when they come."""

    reorder_s: float = Field(0.3, ge=0)
    """How long the frames of other sensors wait at most for an earlier one of this source: a camera is 30 to 300 ms
    behind the odometry. They wait no longer than it was late so far. 0: nobody waits for it [s]."""
