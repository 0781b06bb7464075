"""Config of dead reckoning."""

from __future__ import annotations

from pydantic import Field

from trailmark.config import PluginConfig

__all__ = ["DeadReckoningConfig"]


class DeadReckoningConfig(PluginConfig):
    """Integrates the motion of one localizer; an absolute estimate corrects the pose at its own stamp."""

    history_s: float = Field(default=10.0, gt=0)
    """How late an estimate may come and still correct everything after it [s]."""
    start_sigma_m: float = Field(default=0.01, gt=0)
    """Standard deviation of a known start, along x and along y [m]."""
    start_sigma_deg: float = Field(default=0.5, gt=0)
    """Standard deviation of the heading of a known start [deg]."""
    drift_sigma_mps: float = Field(default=0.5, gt=0)
    """Standard deviation of the velocity while nothing measures it: in a gap, or ahead of the newest motion [m/s]."""
    drift_sigma_deg_per_s: float = Field(default=30.0, gt=0)
    """The same of the yaw rate [deg/s]."""
