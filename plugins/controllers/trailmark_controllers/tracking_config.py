"""Config of the path tracking controller for vehicles of four kinds."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from trailmark.config import PluginConfig

__all__ = ["Drive", "TrackingConfig"]

Drive = Literal["differential", "holonomic", "ackermann", "four_wheel_steering"]


class TrackingConfig(PluginConfig):
    """Path tracking with the law of Micaelli & Samson (1993) and the taught path's own bends."""

    drive: Drive = "differential"
    """What the robot can do: turn on the spot, drive any way, steer its front wheels, or front and rear wheels."""
    speed_mps: float = Field(0.5, gt=0)
    """Speed on straight ways; bends, brakes and a doubtful belief make it slower [m/s]."""
    reverse: bool | None = None
    """Drive from the end to the start; left out, the half of the path on which the robot stands decides."""
    repeat: float = Field(0.5, ge=0.5)
    """Round trips; 0.5 is one way, 10.5 ends at the other end."""
    correct_over_m: float = Field(0.45, gt=0)
    """The way on which offsets vanish [m]."""
    lag_s: float = Field(0.1, ge=0)
    """How late the robot follows a command: so far ahead the path is read [s]."""
    smooth_m: float = Field(0.2, gt=0)
    """Half the stretch of path that one place of it is read from: waypoints carry the noise of what taught them [m]."""
    yaw_limit_dps: float = Field(60.0, gt=0)
    """Fastest turn; in sharper bends the robot slows down [deg/s]."""
    lateral_mps2: float = Field(0.5, gt=0)
    """Largest acceleration to the side; in sharper bends the robot slows down [m/s^2]."""
    accel_mps2: float = Field(0.25, gt=0)
    """How it gathers speed and brakes [m/s^2]."""
    creep_mps: float = Field(0.03, gt=0)
    """Slowest speed towards an end [m/s]."""
    arrive_m: float = Field(0.01, gt=0)
    """An end counts as reached this close to it [m]."""
    turn_first_deg: float = Field(45.0, gt=0, le=90)
    """A differential robot that heads further away than this turns on the spot first [deg]."""
    min_turning_radius_m: float = Field(0.0, ge=0)
    """Smallest radius of an Ackermann vehicle; no sharper bend is asked for [m]."""
    wheelbase_m: float = Field(0.496, gt=0)
    """Distance of the axles of a vehicle with four-wheel steering; that of Nagai & Watanabe 2015 [m]."""
    steer_limit_deg: float = Field(18.3, gt=0, lt=90)
    """Full lock of its wheels [deg]."""
    max_offset_m: float = Field(1.0, gt=0)
    """Stop further off the path than this: nobody has taught that there is room [m]."""
    slow_sigma_m: float = Field(0.1, gt=0)
    """Slow down while the position is less certain than this; checked where the estimator gives a covariance [m]."""
    max_sigma_m: float = Field(0.5, gt=0)
    """Stop while it is less certain than this [m]."""
    max_fix_age_m: float | None = Field(2.0, gt=0)
    """Stop after this way without an accepted fix, slow down after half of it; null: drive on odometry alone [m]."""
    max_motion_age_s: float | None = Field(0.5, gt=0)
    """Stop when the last motion is older than this, slow down at half of it, where motions are given at all [s]."""

    @model_validator(mode="after")
    def _check(self) -> TrackingConfig:
        if (2 * self.repeat) % 1:
            raise ValueError(f"repeat counts round trips in halves (0.5, 1, 1.5, ...), not {self.repeat}")
        if self.creep_mps > self.speed_mps:
            raise ValueError(f"creep_mps ({self.creep_mps}) is faster than speed_mps ({self.speed_mps})")
        if self.slow_sigma_m > self.max_sigma_m:
            raise ValueError(f"slow_sigma_m ({self.slow_sigma_m}) is above max_sigma_m ({self.max_sigma_m})")
        return self
