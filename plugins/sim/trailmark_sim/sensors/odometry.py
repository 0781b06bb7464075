"""Wheel odometry."""

from __future__ import annotations

from dataclasses import dataclass, field

from trailmark.frames import Odometry, SensorInfo
from trailmark_sim.sensors.site import SensorSite
from trailmark_sim.vehicles import VehicleState

__all__ = ["WheelOdometry", "build"]


@dataclass(frozen=True, slots=True)
class WheelOdometry:
    """What the wheels say: dead reckoning with the slip and the wrong scale of the vehicle.

    The vehicle integrates it (`VehicleState.pose_start_wheels`), so that a frame that gets lost loses nothing.

    Attributes
    ----------
    name : str
        Name of the sensor.
    rate_hz : float
        Readings per second [Hz].
    info : SensorInfo
        What is known about it.
    """

    name: str = "wheels"
    rate_hz: float = 50.0
    info: SensorInfo = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "info", SensorInfo(self.name, "odometry", None, self.rate_hz))

    def render(self, k: int, stamp_s: float, state: VehicleState) -> Odometry:
        """Return reading number `k`."""
        return Odometry(state.pose_start_wheels, state.wheels_m, state.twist)


def build(name: str, site: SensorSite) -> WheelOdometry:
    """Return the wheel odometry of a vehicle."""
    return WheelOdometry(name, site.rate_hz(name, 50.0))
