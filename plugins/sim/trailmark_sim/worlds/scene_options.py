"""Options of the worlds with walls; imports nothing heavy."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field

from trailmark.config import PluginConfig

__all__ = ["CorridorOptions", "HallwayOptions", "ImagingOptions", "LabOptions", "StreetOptions", "SupermarketOptions"]

#: Seasons of the street.
Season = Literal["summer", "autumn", "winter"]

#: What changes pictures, but nothing that stands.
_NOT_OF_THE_PLACE = (
    *("exposure", "exposure_ms", "readout_ms", "noise", "blur_px"),
    *("registered", "depth_noise", "vibration_mrad", "width_px"),
    *("people", "dims_s", "dims_to", "crate", "crate_s", "laser_m"),
)


class ImagingOptions(PluginConfig):
    """How the cameras of a world with walls make pictures."""

    exposure: float | None = Field(default=None, gt=0)
    """Fixed exposure of the cameras, a gain; left out: automatic."""
    exposure_ms: float = Field(default=0.0, ge=0, le=1000)
    """While they expose, pictures are smeared by the motion; 0: sharp [ms]."""
    readout_ms: float = Field(default=0.0, ge=0, le=1000)
    """They read their rows one after the other in this time, a rolling shutter; 0: all rows at once [ms]."""
    noise: float = Field(default=1.0, ge=0, le=20)
    """Scales the noise of the cameras; 0 is none."""
    blur_px: float | None = Field(default=None, ge=0, le=5)
    """Blur of the lens, one standard deviation; left out: the world's [px]."""

    def scenery(self) -> Self:
        """Return the options of the place, without those of cameras and of what moves: the same, the same place."""
        fields = type(self).model_fields
        plain = {name: fields[name].default for name in _NOT_OF_THE_PLACE if name in fields}
        return self.model_copy(update=plain)


class SupermarketOptions(ImagingOptions):
    """Options of the world `supermarket`."""

    people: int = Field(default=0, ge=0, le=8)
    """How many people walk about."""
    lighting: Literal["all", "half"] = "all"
    """All lamps, or every other one."""
    alike: bool = False
    """All shelves hold the same goods, walls are bare: only the signs tell one shelf from another."""
    shiny: float = Field(default=0.0, ge=0, le=1)
    """How polished the floor and the glass of the refrigerator are: 1 is a floor and two panes without a scratch."""
    laser_m: float = Field(default=12.0, ge=1, le=60)
    """How far the laser reaches [m]."""


class _RgbdOptions(ImagingOptions):
    people: int = Field(default=0, ge=0, le=4)
    """How many people walk about."""
    light_level: float = Field(default=1.0, gt=0, le=3)
    """Brightness of the lamps; with a fixed exposure pictures become darker, and the light sensor tells."""
    dims_s: float | None = Field(default=None, ge=0)
    """From this stamp on all lamps are turned down; left out: never [s]."""
    dims_to: float = Field(default=0.2, gt=0, le=1)
    """... to this share."""
    crate: Literal["none", "stands", "walks_off", "covered"] = "none"
    """A crate full of print beside the route: it stands, is carried away, or is covered by a cloth."""
    crate_s: float = Field(default=4.0, ge=0)
    """When that begins [s]."""
    registered: bool = False
    """Give depth on the pixels of the colour picture; otherwise as the depth camera sees it."""
    depth_noise: float = Field(default=1.0, ge=0, le=20)
    """Scales the noise of the disparity; 0 is none."""


class LabOptions(_RgbdOptions):
    """Options of the world `lab`."""


class HallwayOptions(_RgbdOptions):
    """Options of the world `hallway`."""


class _ForwardOptions(ImagingOptions):
    people: int = Field(default=0, ge=0, le=6)
    """How many people walk about."""
    time: Literal["morning", "afternoon"] = "morning"
    """Where the sun stands."""
    vibration_mrad: float | None = Field(default=None, ge=0, le=50)
    """How much the floor shakes the camera, one standard deviation; left out: the world's [mrad]."""
    width_px: int = Field(default=640, ge=160, le=1280, multiple_of=4)
    """Width of the front camera's pictures, 4:3 and always of the same view; fewer pixels cost less [px]."""


class CorridorOptions(_ForwardOptions):
    """Options of the world `corridor`."""

    lamps: Literal["all", "half", "off"] = "all"
    """Which lamps are on."""


class StreetOptions(_ForwardOptions):
    """Options of the world `street`."""

    cars: int = Field(default=4, ge=0, le=6)
    """How many cars are parked."""
    season: Season = "summer"
    """In autumn leaves have turned, and many lie on the ground; in winter trees are bare and snow lies in patches."""
