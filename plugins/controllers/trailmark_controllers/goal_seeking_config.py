"""Config of the goal seeking controller."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from trailmark.config import PluginConfig

__all__ = ["GoalSeekingConfig"]


class GoalSeekingConfig(PluginConfig):
    """Drives to a place in the map, whatever the start (Tasaki et al. 2010, Sec. IV-C)."""

    goal: tuple[float, float] | tuple[float, float, float]
    """Where to: [x, y], or [x, y, deg] to end with a heading; metres and degrees in the map."""
    drive: Literal["differential", "holonomic"] = "differential"
    """What the robot can do: turn and drive forward, or drive any way at once."""
    way: Literal["taught", "straight"] = "taught"
    """In replay, along the taught path as far as it leads towards the goal, or straight from the start. Nothing
    looks out for what stands in the way."""
    lookahead_m: float = Field(0.4, gt=0)
    """On the taught path it heads for the point so far ahead [m]."""
    speed_mps: float = Field(0.5, gt=0)
    """Speed far from the goal; the paper's robot could do 1.0 m/s [m/s]."""
    creep_mps: float = Field(0.03, gt=0)
    """Slowest speed while braking [m/s]."""
    slow_down_m: float = Field(0.6, ge=0)
    """Brake evenly over this distance before the goal [m]."""
    turn_dps: float = Field(45.0, gt=0)
    """Fastest turn [deg/s]."""
    turn_gain: float = Field(1.5, gt=0)
    """Yaw rate per angle to turn [1/s]."""
    turn_first_deg: float = Field(30.0, gt=0, lt=90)
    """A differential robot that looks further away from the goal turns on the spot first [deg]."""
    reverse_m: float = Field(0.3, ge=0)
    """A differential robot drives back to a goal that lies behind it and nearer than this [m]."""
    search_dps: float = Field(0.0, ge=0)
    """Turn on the spot so fast, twice around, while the pose is not known yet: another heading may show more. 0: stand
    [deg/s]."""
    search_wait_s: float = Field(0.0, ge=0)
    """Stand so long before that turn: most places are known without it, and there may be no room to turn [s]."""
    arrive_m: float = Field(0.02, gt=0)
    """The goal counts as reached this close to it [m]."""
    arrive_deg: float = Field(2.0, gt=0, lt=180)
    """And with its heading this close, where the goal has one [deg]."""
    settle_steps: int = Field(5, ge=1)
    """So many steps in a row, standing, must say that the goal is reached: a fix that comes in may correct it."""
    max_sigma_m: float = Field(0.5, gt=0)
    """Stop while the position is less certain than this; checked where the estimator gives a covariance [m]."""
    max_fix_age_m: float | None = Field(2.0, gt=0)
    """Stop after this way without an accepted fix, and before the first; null: drive on odometry alone [m]."""

    @model_validator(mode="after")
    def _check(self) -> GoalSeekingConfig:
        if self.creep_mps > self.speed_mps:
            raise ValueError(f"creep_mps ({self.creep_mps}) is faster than speed_mps ({self.speed_mps})")
        return self
