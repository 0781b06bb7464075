"""The ground camera in the catalogue; `trailmark_sim.ground.camera` has the sensor."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark.errors import ConfigError
from trailmark_sim.ground.camera import GroundCameraSensor, GroundRig
from trailmark_sim.ground.ground import Floor, GroundTexture, Zone
from trailmark_sim.ground.optics import Optics
from trailmark_sim.rng import stream_key
from trailmark_sim.sensors.site import SensorSite

if TYPE_CHECKING:
    from trailmark_sim.worlds.base import WorldOptions

__all__ = ["build", "camera_over"]


def build(name: str, site: SensorSite) -> GroundCameraSensor:
    """Return the camera that looks down on the ground of a world.

    Raises
    ------
    ConfigError
        If the world has no painted ground.
    """
    if site.floor_camera is None:
        raise ConfigError(f"sim: world {site.world!r} has no painted ground for sensor {name!r}")
    return site.floor_camera(name)


def camera_over(floor: str, world: str, options: WorldOptions, name: str) -> GroundCameraSensor:
    """Return a camera named `name` over a world whose ground is one built-in floor everywhere."""
    rig = GroundRig(rate_hz=options.rate_of(name, 70.0))
    texel_m = min(rig.metres_per_pixel) / 1.5
    ground = GroundTexture([Zone(Floor(floor))], stream_key(options.world_seed, world), texel_m=texel_m)
    return GroundCameraSensor(name, ground, rig, Optics(), options.seed, threads=options.threads)
