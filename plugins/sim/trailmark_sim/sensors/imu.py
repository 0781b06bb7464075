"""An inertial measurement unit."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from trailmark.frames import Imu, SensorInfo
from trailmark.geometry import Pose3
from trailmark_sim.rng import frame_rng
from trailmark_sim.sensors.site import SensorSite
from trailmark_sim.vehicles import VehicleState

__all__ = ["ImuSensor", "build"]

_GRAVITY_MPS2 = 9.80665


@dataclass(frozen=True, slots=True)
class ImuSensor:
    """Rates and accelerations in sensor axes, with a constant bias and white noise.

    Attributes
    ----------
    name : str
        Name of the sensor.
    rate_hz : float
        Readings per second [Hz].
    seed : int
        Of bias and noise.
    mounting : Pose3
        ``point_base = mounting @ point_sensor``; away from base it also feels the turning.
    gyro_noise, gyro_bias : float
        Standard deviation of the noise of a reading, and of the bias [rad/s].
    accel_noise, accel_bias : float
        The same of the accelerations [m/s^2].
    info : SensorInfo
        What is known about it.
    """

    name: str = "imu"
    rate_hz: float = 100.0
    seed: int = 0
    mounting: Pose3 = Pose3()
    gyro_noise: float = math.radians(0.1)
    gyro_bias: float = math.radians(0.2)
    accel_noise: float = 0.03
    accel_bias: float = 0.05
    info: SensorInfo = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "info", SensorInfo(self.name, "imu", None, self.rate_hz, self.mounting))

    def render(self, k: int, stamp_s: float, state: VehicleState) -> Imu:
        """Return reading number `k`."""
        bias = frame_rng(self.seed, f"{self.name}/bias").standard_normal(6)
        noise = frame_rng(self.seed, f"{self.name}/noise", k).standard_normal(6)
        rotation_sensor_base = self.mounting.rotation().T
        rates = rotation_sensor_base @ np.array([0.0, 0.0, state.twist.yaw_radps])
        force = rotation_sensor_base @ self._force(state)
        return Imu(
            rates + self.gyro_bias * bias[:3] + self.gyro_noise * noise[:3],
            force + self.accel_bias * bias[3:] + self.accel_noise * noise[3:],
        )

    def _force(self, state: VehicleState) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """Return the specific force at the sensor, in base axes: a + alpha x r - omega^2 r - g."""
        x, y, omega, alpha = self.mounting.x, self.mounting.y, state.twist.yaw_radps, state.yaw_radps2
        return np.array(
            [
                state.forward_mps2 - alpha * y - omega * omega * x,
                state.left_mps2 + alpha * x - omega * omega * y,
                _GRAVITY_MPS2,
            ]
        )


def build(name: str, site: SensorSite) -> ImuSensor:
    """Return the inertial measurement unit of a vehicle."""
    return ImuSensor(name, site.rate_hz(name, 100.0), site.options.seed)
