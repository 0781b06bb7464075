"""Config of the sink."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from trailmark.config import PluginConfig

__all__ = ["MavlinkSinkConfig"]


class MavlinkSinkConfig(PluginConfig):
    """Where beliefs go, and how."""

    host: str = "127.0.0.1"
    """Address of the autopilot, or of what passes messages on to it. MAVLink knows no login."""
    port: int = Field(14550, ge=1, le=65535)
    """UDP port there."""
    messages: tuple[Literal["odometry", "vision_position_estimate"], ...] = ("odometry",)
    """What is sent: ODOMETRY (ArduPilot, PX4), VISION_POSITION_ESTIMATE (older ones), or both."""
    rate_hz: float = Field(30.0, gt=0)
    """How often at most [Hz]."""
    north_deg: float = 0.0
    """Direction of north in the map, counter-clockwise from its x axis, for VISION_POSITION_ESTIMATE [deg]."""
    max_sigma_m: float = Field(0.5, gt=0)
    """A position that is less certain is not sent: an autopilot takes what it gets [m]."""
    jump_m: float = Field(0.1, gt=0)
    """A belief that moves this far beside what motion says has jumped: the autopilot is told (reset_counter) [m]."""
    system: int = Field(1, ge=1, le=255)
    """System id of the vehicle."""
