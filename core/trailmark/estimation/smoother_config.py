"""Config of the fixed-lag smoother."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from trailmark.config import PluginConfig

__all__ = ["RobustLoss", "SmootherConfig"]

RobustLoss = Literal["dcs", "huber", "none"]


class SmootherConfig(PluginConfig):
    """Estimates the poses of a window of time together: what is said later corrects what was believed before."""

    lag_s: float = Field(default=10.0, gt=0)
    """Length of the window, and how late an estimate may come [s]."""
    loss: RobustLoss = "dcs"
    """How an absolute estimate loses weight with its distance from the poses on which the others agree: "dcs" forgets
    it (dynamic covariance scaling), "huber" lets it pull with a bounded force, "none" takes all at their word."""
    gate: float | Literal["off"] = 0.999
    """Probability with which a right estimate passes the chi-square test, where the loss begins; "off": neither."""
    motions: Literal["independent", "intersection"] = "independent"
    """Several localizers that give motion of one interval: their errors have nothing in common, or nobody knows."""
    recover_after: int = Field(default=5, ge=2)
    """How many more must be rejected of one localizer than accepted until the poses are sought anew."""
    start_sigma_m: float = Field(default=0.01, gt=0)
    """Standard deviation of a known start, along x and along y [m]."""
    start_sigma_deg: float = Field(default=0.5, gt=0)
    """Standard deviation of the heading of a known start [deg]."""
    drift_sigma_mps: float = Field(default=0.5, gt=0)
    """Standard deviation of the velocity while nothing measures it: in a gap, or ahead of the newest motion [m/s]."""
    drift_sigma_deg_per_s: float = Field(default=30.0, gt=0)
    """The same of the yaw rate [deg/s]."""
    coast_s: float = Field(default=1.0, gt=0)
    """How long the last velocity is held in a gap [s]."""
    floor_m: float = Field(default=1e-6, gt=0)
    """Smallest standard deviation of a position that is believed [m]."""
    floor_deg: float = Field(default=1e-4, gt=0)
    """Smallest standard deviation of a heading that is believed [deg]."""
    timeout_s: float = Field(default=2.0, gt=0)
    """Silence of a localizer that is reported in the health of the belief [s]."""
    max_speed_mps: float = Field(default=100.0, gt=0)
    """A motion that is faster is refused [m/s]."""
    time_jump_s: float = Field(default=60.0, gt=0)
    """A stamp that is further than this from the newest is a jump of the clock [s]."""
    time_jump_after: int = Field(default=5, ge=1)
    """How many estimates in a row must agree on a new time until the smoother begins anew there."""
    max_per_stamp: int = Field(default=64, ge=1)
    """Absolute estimates of one localizer about one instant; more are refused: its clock stands still."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if isinstance(self.gate, float) and not 0.0 < self.gate < 1.0:
            raise ValueError(f'gate must be a probability between 0 and 1, or "off", not {self.gate:g}')
        if self.time_jump_s <= self.lag_s:
            raise ValueError(f"time_jump_s ({self.time_jump_s:g}) must be longer than lag_s ({self.lag_s:g})")
        return self
