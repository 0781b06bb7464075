"""An ambient light sensor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from trailmark.frames import Scalar, SensorInfo
from trailmark.geometry import Pose2
from trailmark_sim.rng import frame_rng
from trailmark_sim.sensors.site import SensorSite
from trailmark_sim.vehicles import VehicleState

__all__ = ["LightSensor", "build"]


@dataclass(frozen=True, slots=True)
class LightSensor:
    """How bright it is around the vehicle.

    Attributes
    ----------
    level_lux : callable
        Takes the pose of the vehicle and the stamp and returns the light there [lux].
    name : str
        Name of the sensor.
    rate_hz : float
        Readings per second [Hz].
    seed : int
        Of the noise.
    noise : float
        Standard deviation of a reading, as a share of it.
    step_lux : float
        What the reading is rounded to [lux].
    info : SensorInfo
        What is known about it.
    """

    level_lux: Callable[[Pose2, float], float]
    name: str = "light"
    rate_hz: float = 10.0
    seed: int = 0
    noise: float = 0.02
    step_lux: float = 1.0
    info: SensorInfo = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "info", SensorInfo(self.name, "scalar", None, self.rate_hz))

    def render(self, k: int, stamp_s: float, state: VehicleState) -> Scalar:
        """Return reading number `k` [lux]."""
        noise = float(frame_rng(self.seed, f"{self.name}/noise", k).standard_normal())
        lux = max(0.0, self.level_lux(state.pose_map_base, stamp_s) * (1.0 + self.noise * noise))
        return Scalar(round(lux / self.step_lux) * self.step_lux)


def build(name: str, site: SensorSite) -> LightSensor:
    """Return the light sensor of a vehicle."""
    return LightSensor(site.level_lux, name, site.rate_hz(name, 10.0), site.options.seed)
