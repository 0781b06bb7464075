"""A sensor under another name."""

from __future__ import annotations

from dataclasses import dataclass, replace

from trailmark.frames import Payload, SensorInfo
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds.base import SensorModel

__all__ = ["named"]


@dataclass(frozen=True, slots=True)
class _Renamed:
    sensor: SensorModel
    info: SensorInfo

    @property
    def rate_hz(self) -> float:
        return self.sensor.rate_hz

    def render(self, k: int, stamp_s: float, state: VehicleState) -> Payload:
        return self.sensor.render(k, stamp_s, state)


def named(sensor: SensorModel, name: str) -> SensorModel:
    """Return the sensor under a name; its readings stay what they were."""
    return sensor if sensor.info.name == name else _Renamed(sensor, replace(sensor.info, name=name))
