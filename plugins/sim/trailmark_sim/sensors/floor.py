"""The ground camera in the catalogue; `trailmark_sim.ground.camera` has the sensor."""

from __future__ import annotations

from trailmark.errors import ConfigError
from trailmark_sim.ground.camera import GroundCameraSensor
from trailmark_sim.sensors.site import SensorSite

__all__ = ["build"]


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
