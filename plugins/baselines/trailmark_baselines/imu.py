"""An inertial unit as a localizer: a gyro, and where the unit has one a compass."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Belief, Estimate, Fix, Lost, Motion, information_from_sigmas
from trailmark.frames import Frame, Imu
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, Session
from trailmark_baselines.config import ImuConfig

__all__ = ["ImuLocalizer"]

logger = logging.getLogger(__name__)

#: Specific forces that are gravity in the main [m/s^2]; units that take it off tell nothing of how they lie.
_LEAST_GRAVITY, _MOST_GRAVITY = 7.0, 12.5
#: No robot feels more [m/s^2].
_MOST_FORCE = 1e6
#: Time over which forces are averaged, and after which they count: a robot shakes and brakes [s].
_SETTLES_S, _SETTLED_S = 1.0, 0.5
#: Share of gravity along the vertical axis of base, below which the unit lies on its side: 45 deg.
_UPRIGHT = math.cos(math.radians(45.0))


class ImuLocalizer(Localizer):
    """Says how base has turned, and where it heads if the unit knows; both are of rank one.

    The turn is a `Motion` that measured no way, the heading a `Fix` that measured no place. Where gravity says that the
    unit does not lie as its mounting says, the rate about the vertical is another, and it is `Lost`.
    """

    config: ImuConfig
    uses_belief = False

    def start(self, session: Session) -> None:
        """Read the unit's mounting, and forget the last reading."""
        self._rotation_base_imu = session.sensors[self.config.imu].pose_base_sensor.rotation()
        self._last: tuple[float, float] | None = None
        self._name = session.name
        self._force: Floats | None = None
        self._force_begun_s = self._force_s = 0.0
        self._has_told: set[str] = set()
        sigma_deg = self.config.heading_sigma_deg
        self._heading_information = None if sigma_deg is None else _of_heading(math.radians(sigma_deg))

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return the turn since the last reading, and the heading."""
        reading = frame.payload
        if not isinstance(reading, Imu):
            return ()
        rate_radps = float(self._rotation_base_imu[2] @ reading.angular_velocity_radps)
        if not math.isfinite(rate_radps):
            self._last = None
            return (Lost(frame.stamp_s, "the rate is not a number"),)
        if reason := self._lies_otherwise(frame.stamp_s, reading.linear_acceleration_mps2):
            self._last = None
            return (Lost(frame.stamp_s, reason),)
        if reading.quat_xyzw is not None and self._heading_information is None:
            self._tell("it tells an orientation, which is not used: set heading_sigma_deg if it has a compass")
        rate_radps -= math.radians(self.config.bias_deg_per_s)
        last, self._last = self._last, (frame.stamp_s, rate_radps)
        estimates: list[Estimate] = []
        if last is not None and frame.stamp_s - last[0] <= self.config.max_gap_s:
            estimates.append(self._turn(*last, frame.stamp_s, rate_radps))
        information = self._heading_information
        if information is not None and reading.quat_xyzw is not None:
            estimates.append(self._heading(frame.stamp_s, reading.quat_xyzw, information))
        return estimates

    def _lies_otherwise(self, stamp_s: float, force_mps2: Floats | None) -> str:
        """Return why the mounting cannot be as it is stated, by where gravity pulls on average; empty where it can."""
        if force_mps2 is None or not (np.abs(force_mps2) < _MOST_FORCE).all():  # nor is what is not finite
            return ""
        force = self._rotation_base_imu @ force_mps2
        if self._force is None or not 0.0 <= stamp_s - self._force_s <= self.config.max_gap_s:
            self._force, self._force_begun_s = force, stamp_s
        else:
            share = min(1.0, (stamp_s - self._force_s) / _SETTLES_S)
            self._force = self._force + share * (force - self._force)
        self._force_s = stamp_s
        pull = float(np.linalg.norm(self._force))
        if stamp_s - self._force_begun_s < _SETTLED_S or not _LEAST_GRAVITY <= pull <= _MOST_GRAVITY:
            return ""
        x, y, z = (self._force / pull).tolist()
        if z < -_UPRIGHT:
            self._tell("gravity says that it hangs upside down: if so, set roll_deg: 180 in the mounting of its sensor")
        if abs(z) >= _UPRIGHT:
            return ""
        axis = "x" if abs(x) > abs(y) else "y"
        return f"gravity pulls along {axis} of base: the unit lies on its side; set the mounting of its sensor"

    def _tell(self, fact: str) -> None:
        if fact not in self._has_told:
            self._has_told.add(fact)
            logger.warning("localizer %r: %s", self._name, fact)

    def _turn(self, since_s: float, before_radps: float, stamp_s: float, rate_radps: float) -> Motion:
        dt_s = stamp_s - since_s
        turn = Pose2(0.0, 0.0, (before_radps + rate_radps) / 2.0 * dt_s)
        return Motion(since_s, stamp_s, turn, _of_heading(math.radians(self.config.turn_sigma_deg) * math.sqrt(dt_s)))

    def _heading(self, stamp_s: float, quat_xyzw: Floats, information: Floats) -> Fix | Lost:
        norm = math.sqrt(quat_xyzw.dot(quat_xyzw))
        if not (math.isfinite(norm) and norm > 0.5):  # some drivers send zeros for "unknown"
            return Lost(stamp_s, f"the orientation is no rotation: its quaternion has norm {norm:.3g}")
        forward = _rotation(quat_xyzw / norm) @ self._rotation_base_imu[0]  # base's x axis, in the unit's world
        heading_rad = math.atan2(float(forward[1]), float(forward[0])) + math.radians(self.config.north_deg)
        return Fix(stamp_s, Pose2(0.0, 0.0, heading_rad), information)


def _of_heading(sigma_rad: float) -> Floats:
    return information_from_sigmas(math.inf, math.inf, sigma_rad)


def _rotation(quat_xyzw: Floats) -> Floats:
    x, y, z, w = quat_xyzw.tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
