"""What a simulated sensor is, and what a world offers to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from trailmark.errors import ConfigError
from trailmark.frames import Payload, SensorInfo
from trailmark.geometry import Pose2
from trailmark_sim.vehicles import VehicleState

if TYPE_CHECKING:
    from trailmark_sim.ground.camera import GroundCameraSensor
    from trailmark_sim.sensors.shutter import Imaging
    from trailmark_sim.stage import Stage
    from trailmark_sim.worlds.base import WorldOptions

__all__ = ["SensorModel", "SensorSite"]


class SensorModel(Protocol):
    """A simulated sensor. What it reads depends on (seed, k, stamp, state) alone, never on what it read before."""

    @property
    def info(self) -> SensorInfo:
        """Name, kind, size, mounting and calibration."""

    @property
    def rate_hz(self) -> float:
        """Readings per second; reading k is taken at ``k / rate_hz``."""

    def render(self, k: int, stamp_s: float, state: VehicleState) -> Payload:
        """Return reading number `k`, taken at `stamp_s` from a vehicle in `state`."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SensorSite:
    """What a world offers to the sensors of its vehicle.

    Attributes
    ----------
    world : str
        Name of the world.
    options : WorldOptions
        Seed, rates and threads that the config gives.
    level_lux : callable
        Takes the pose of the vehicle and the stamp and returns the light there [lux].
    stage : Stage or None
        What can be looked at; None: nothing stands in this world.
    imaging : Imaging or None
        How its cameras turn light into pictures.
    rigs : mapping of str to object
        Size, place and rate of a sensor, by name: `CameraRig`, `LaserRig`, `RgbdRig`.
    floor_camera : callable or None
        Takes a name and returns a camera over the ground; None: the world has no painted ground.
    """

    world: str
    options: WorldOptions
    level_lux: Callable[[Pose2, float], float]
    stage: Stage | None = None
    imaging: Imaging | None = None
    rigs: Mapping[str, Any] = field(default_factory=dict)
    floor_camera: Callable[[str], GroundCameraSensor] | None = None

    def rate_hz(self, sensor: str, default_hz: float) -> float:
        """Return the rate of a sensor: the config's, or the default [Hz]."""
        return self.options.rate_of(sensor, default_hz)

    def stage_for(self, sensor: str) -> Stage:
        """Return what a sensor looks at.

        Raises
        ------
        ConfigError
            If nothing stands in the world.
        """
        if self.stage is None:
            raise ConfigError(f"sim: sensor {sensor!r} needs walls to look at; world {self.world!r} has only a floor")
        return self.stage
