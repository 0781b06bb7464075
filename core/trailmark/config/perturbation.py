"""What can be wrong with a sensor: the option ``perturb`` of every source."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from trailmark.config.base import PluginConfig

__all__ = ["Occluders", "Perturbation", "WrongCalibration"]


class Occluders(PluginConfig):
    """Things that pass in front of a camera, each of one grey."""

    n: int = Field(default=2, ge=1)
    """How many."""
    size: float = Field(default=0.2, gt=0, le=1)
    """Side of each, as a share of the shorter side of the picture."""
    speed: float = Field(default=0.2, ge=0)
    """How fast they cross [widths of the picture per second]."""


class WrongCalibration(PluginConfig):
    """What is believed of a sensor and is not so; its readings stay as they are."""

    scale: float = Field(default=1.0, gt=0)
    """Metres per pixel of a ground camera, focal lengths of others: times this."""
    x_m: float = 0.0
    """The sensor is believed to sit so much further forward [m]."""
    y_m: float = 0.0
    """Further to the left [m]."""
    yaw_deg: float = 0.0
    """Turned by so much more, counter-clockwise [deg]."""
    pitch_deg: float = 0.0
    """Nodding by so much more [deg]."""


class Perturbation(PluginConfig):
    """Faults of sensors, for tables that show where a method breaks. Every default is no fault."""

    sensors: tuple[str, ...] | None = None
    """Which sensors of the source; left out: all that a fault can befall."""
    noise: float = Field(default=0.0, ge=0)
    """Noise of pictures, standard deviation [grey levels of 255]."""
    blur_px: float = Field(default=0.0, ge=0)
    """Gaussian blur of pictures, standard deviation [px]."""
    exposure: float = Field(default=1.0, gt=0)
    """Brightness of pictures: times this, cut off at white."""
    flicker: float = Field(default=0.0, ge=0)
    """Brightness changes from picture to picture: standard deviation of the logarithm of the factor."""
    speckle: float = Field(default=0.0, ge=0, le=1)
    """Share of pixels that are black or white, and of laser beams that return from anywhere."""
    range_noise_m: float = Field(default=0.0, ge=0)
    """Noise of laser ranges and of depth, standard deviation [m]."""
    occluders: Occluders | None = None
    """Things that pass in front of a camera."""
    dropped: float = Field(default=0.0, ge=0, lt=1)
    """Share of frames that are lost."""
    dropped_in_a_row: float | None = Field(default=None, ge=1)
    """How many are lost at a time, on average; left out: each by itself."""
    missing_s: tuple[float, float] | None = None
    """A time in which the sensor says nothing, from and to, since the first frame [s]."""
    late_s: float = Field(default=0.0, ge=0)
    """Stamps say when a frame arrived, and it took so long [s]."""
    wrong: WrongCalibration | None = None
    """What is believed of the sensor and is not so."""

    @model_validator(mode="after")
    def _times_are_in_order(self) -> Self:
        if self.missing_s is not None and not 0.0 <= self.missing_s[0] < self.missing_s[1]:
            raise ValueError(f"missing_s is [from, to] with 0 <= from < to, not {list(self.missing_s)}")
        shortest = self.dropped / (1.0 - self.dropped)
        if self.dropped_in_a_row is not None and self.dropped_in_a_row < shortest - 1e-9:
            raise ValueError(
                f"a share of {self.dropped:g} cannot be lost in runs of {self.dropped_in_a_row:g}:"
                f" they must be {shortest:.3g} long at least"
            )
        return self
