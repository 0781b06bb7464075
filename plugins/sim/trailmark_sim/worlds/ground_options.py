"""Options of the ground course."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from trailmark.config import ExistingPath, PluginConfig

__all__ = ["CameraOptions", "Covered", "DayOptions", "FloorOptions", "GroundCourseOptions"]

FloorName = Literal["asphalt", "carpet", "concrete", "gravel", "pavers", "soil", "terrazzo", "wood"]


class FloorOptions(PluginConfig):
    """One kind of floor: a built-in one, or a photograph."""

    floor: FloorName | None = None
    """A built-in floor."""
    texture: ExistingPath | None = None
    """A photograph to make an endless floor of."""
    texture_width_m: float | None = Field(default=None, gt=0)
    """Width of the floor that the photograph shows; left out: 0.39 mm a pixel, the paper's camera [m]."""
    floor_yaw_deg: float = 0.0
    """Direction in which planks, stones or the photograph's rows run [deg]."""

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if self.floor is not None and self.texture is not None:
            raise ValueError(f"give floor ({self.floor}) or texture ({self.texture}), not both")
        return self


class Covered(FloorOptions):
    """A stretch of the route that is covered with another floor."""

    from_m: float = Field(ge=0)
    """Where it begins, along the route [m]."""
    to_m: float = Field(gt=0)
    """Where it ends, along the route [m]."""
    width_m: float = Field(default=1.0, gt=0)
    """How wide it is, the route in its middle [m]."""
    when: Literal["replay", "always"] = "replay"
    """Laid after teaching, as in the paper, or there from the beginning."""

    @model_validator(mode="after")
    def _is_a_stretch(self) -> Self:
        if self.to_m <= self.from_m:
            raise ValueError(f"to_m ({self.to_m:g}) must lie beyond from_m ({self.from_m:g})")
        if self.floor is None and self.texture is None:
            raise ValueError("say what covers it: floor or texture")
        return self


class DayOptions(PluginConfig):
    """How the ground and the light are on a day."""

    day: int = Field(default=1, ge=0)
    """Which day: dirt, leaves and water lie elsewhere on another."""
    dirt: float = Field(default=0.0, ge=0, le=1)
    """Weight of a layer of dirt; at 1 its greys deviate by about 10."""
    leaves_per_m2: float = Field(default=0.0, ge=0, le=100)
    """Leaves on a square metre."""
    wet: float = Field(default=0.0, ge=0, le=1)
    """Share of the ground that is wet."""
    gain: float = Field(default=1.0, gt=0)
    """Gain of the camera."""
    offset: float = 0.0
    """Offset of the camera [grey levels]."""


class CameraOptions(PluginConfig):
    """The ground camera; the defaults are a plain industrial camera of the paper's size."""

    width: int = Field(default=512, ge=16, le=4096)
    """Width of the picture [px]."""
    height: int = Field(default=480, ge=16, le=4096)
    """Height of the picture [px]."""
    field_mm: tuple[float, float] = (200.0, 188.0)
    """What it sees of the ground, along and across the picture's rows [mm]."""
    x_m: float = 0.0
    """How far before the middle of the vehicle it looks down [m]."""
    yaw_deg: float = 180.0
    """How it is turned; 180: the vehicle's forward is the picture's -u, as in the paper [deg]."""
    psf_px: float = Field(default=0.7, ge=0)
    """Blur of the lens, one standard deviation [px]."""
    vignette: float = Field(default=0.25, ge=0, lt=1)
    """Light lost in the corners."""
    read_noise: float = Field(default=0.8, ge=0)
    """Noise of a black pixel [grey levels]."""
    shot_noise: float = Field(default=1.6, ge=0)
    """Further noise of a white pixel [grey levels]."""
    exposure_ms: float = Field(default=0.5, ge=0)
    """While it exposes, the picture is smeared by the motion [ms]."""
    readout_ms: float = Field(default=0.0, ge=0, le=1000)
    """It reads its rows one after the other in this time, a rolling shutter; 0: all rows at once [ms]."""
    height_jitter: float = Field(default=5e-4, ge=0, lt=0.2)
    """How much the camera's height varies, as a share of it."""
    tilt_jitter_mrad: float = Field(default=0.2, ge=0, lt=100)
    """How much the camera rolls and pitches [mrad]."""
    tiles_mb: float = Field(default=128.0, ge=16)
    """Memory for painted ground [MB]; 8 MB hold a metre of the way."""

    @model_validator(mode="after")
    def _sees_something(self) -> Self:
        if min(self.field_mm) <= 0:
            raise ValueError(f"field_mm must be two positive lengths, not {list(self.field_mm)}")
        return self


class GroundCourseOptions(FloorOptions):
    """Options of the world `ground_course`; a floor given here replaces the floors of the course everywhere."""

    covered: tuple[Covered, ...] = ()
    """Stretches of the route that are covered with another floor."""
    today: DayOptions = DayOptions()
    """How the ground is."""
    in_replay: DayOptions | None = None
    """How it is when the path is driven again; left out: as on the day of teaching."""
    camera: CameraOptions = CameraOptions()
    """The ground camera."""
