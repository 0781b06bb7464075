"""Config of the path tracking controller."""

from __future__ import annotations

from pydantic import Field, model_validator

from trailmark.config import PluginConfig

__all__ = ["PathTrackingConfig"]


class PathTrackingConfig(PluginConfig):
    """Path tracking with front and rear steering (Nagai & Watanabe 2015, Sec. III-B)."""

    speed_mps: float = Field(0.26, gt=0)
    """Speed along the path; the paper's outdoor run averaged 0.26 m/s [m/s]."""
    reverse: bool | None = None
    """Drive from the end to the start; left out, the end at which the robot stands decides."""
    repeat: float = Field(0.5, ge=0.5)
    """Round trips; 0.5 is one way, 10.5 ends at the other end."""
    gain_position: float = Field(0.6, ge=0)
    """K_p of Eq. (8): same-phase steering per pixel of offset."""
    gain_heading: float = Field(16.0, ge=0)
    """K_r of Eq. (8): opposite-phase steering per degree of heading error."""
    pixel_m: float = Field(3.9e-4, gt=0)
    """Metres per pixel, which makes K_p of Eq. (8) dimensionless [m]."""
    limit_units: float = Field(100.0, gt=0)
    """Steering command at full lock, in the units of Eq. (8)."""
    limit_deg: float = Field(18.3, gt=0, lt=90)
    """Steering angle at full lock [deg]."""
    lookahead_m: float = Field(0.05, gt=0)
    """P_m is the nearest waypoint ahead that is farther away than this [m]."""
    arrive_m: float = Field(0.005, gt=0)
    """An end counts as reached this close to it [m]."""
    slow_down_m: float = Field(0.10, ge=0)
    """Brake evenly over this distance before an end [m]."""
    creep_mps: float = Field(0.05, gt=0)
    """Slowest speed while braking [m/s]."""

    @model_validator(mode="after")
    def _check(self) -> PathTrackingConfig:
        if (2 * self.repeat) % 1:
            raise ValueError(f"repeat counts round trips in halves (0.5, 1, 1.5, ...), not {self.repeat}")
        if self.creep_mps > self.speed_mps:
            raise ValueError(f"creep_mps ({self.creep_mps}) is faster than speed_mps ({self.speed_mps})")
        return self
