"""A one-file plugin for ``benchmarks/fusion.py``: an inertial unit as a gyro (`Motion`) and as a compass (`Fix`).

Both are of rank one: the turn between two readings, and the heading. How the unit is mounted is in its `SensorInfo`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from pydantic import Field

from trailmark import hookimpl
from trailmark.config import PluginConfig, Sensor
from trailmark.estimates import Belief, Estimate, Fix, Motion, information_from_sigmas
from trailmark.frames import Frame, Imu
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, Session

if TYPE_CHECKING:
    from trailmark.plugins import Registry


class InertialConfig(PluginConfig):
    """What an inertial unit says of the heading."""

    imu: Sensor["imu"]  # noqa: F821, UP037
    """The inertial unit."""
    turn_sigma_deg: float = Field(0.2, gt=0)
    """Error of the turn after 1 s; grows with the root of the time [deg per root s]."""
    heading_sigma_deg: float | None = Field(None, gt=0)
    """Standard deviation of the absolute heading; left out: it is not used [deg]."""


class Inertial(Localizer):
    """Says how base has turned, and where it heads if the unit knows."""

    config: InertialConfig

    def start(self, session: Session) -> None:
        """Look up how the unit is mounted."""
        self._rotation_base_imu = session.sensors[self.config.imu].pose_base_sensor.rotation()
        self._last: tuple[float, float] | None = None

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return the turn since the last reading, and the heading."""
        reading = frame.payload
        if not isinstance(reading, Imu):
            return ()
        rate_radps = float((self._rotation_base_imu @ reading.angular_velocity_radps)[2])
        estimates: list[Estimate] = []
        if self._last is not None:
            since_s, before_radps = self._last
            dt_s = frame.stamp_s - since_s
            sigma_rad = math.radians(self.config.turn_sigma_deg) * math.sqrt(dt_s)
            turn = Pose2(0.0, 0.0, (before_radps + rate_radps) / 2.0 * dt_s)
            estimates.append(Motion(since_s, frame.stamp_s, turn, _heading_only(sigma_rad)))
        self._last = frame.stamp_s, rate_radps
        if self.config.heading_sigma_deg is not None and reading.quat_xyzw is not None:
            heading = Pose2(0.0, 0.0, _yaw(_rotation(reading.quat_xyzw) @ self._rotation_base_imu.T))
            estimates.append(Fix(frame.stamp_s, heading, _heading_only(math.radians(self.config.heading_sigma_deg))))
        return estimates


def _heading_only(sigma_rad: float) -> npt.NDArray[np.float64]:
    return information_from_sigmas(math.inf, math.inf, sigma_rad)


def _yaw(rotation: npt.NDArray[np.float64]) -> float:
    return math.atan2(float(rotation[1, 0]), float(rotation[0, 0]))


def _rotation(quat_xyzw: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    x, y, z, w = (quat_xyzw / np.linalg.norm(quat_xyzw)).tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register the localizer."""
    registry.localizer(
        "inertial", ":Inertial", config=":InertialConfig", summary="Turn and heading of an IMU", gives=("motion", "fix")
    )
