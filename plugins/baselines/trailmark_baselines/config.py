"""Configs of the localizers without a method of their own."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, field_validator

from trailmark.config import PluginConfig, Sensor

__all__ = ["ConstantSpeedConfig", "ImuConfig", "OdometryConfig", "PoseFixesConfig"]


class OdometryConfig(PluginConfig):
    """Slip of wheel odometry: random walks, so that their variances add up, however the way is cut into steps."""

    wheels: Sensor["odometry"]
    """The odometry."""
    reads: Literal["pose", "velocity"] = "pose"
    """What is taken of a frame: the way since the start, which loses nothing with a frame, or the velocity, averaged
    over two frames; where the robot adds up its way worse than it measures its speed."""
    distance_sigma: float = Field(0.03, gt=0)
    """Error of the distance after 1 m; grows with the root of the way [m per root m]."""
    lateral_sigma: float = Field(0.02, gt=0)
    """Sideways slip after 1 m; grows with the root of the way [m per root m]."""
    turn_sigma_deg: float = Field(2.0, gt=0)
    """Error of the heading after 1 m; grows with the root of the way [deg per root m]."""
    turning_sigma_deg: float = Field(3.0, ge=0)
    """Error of the heading after a turn of 1 rad; grows with the root of the turn [deg per root rad]."""
    slip_sigma: float = Field(0.02, ge=0)
    """Error of the position after a turn of 1 rad, whose centre is not quite base; grows with the root of the turn
    [m per root rad]."""
    lag_s: float = Field(0.3, ge=0)
    """The body may follow the readings, or be ahead of them, by this: commands that are told as measured, filters,
    stamps of arrival. Where the speed changes, the motion is as uncertain as that; 0: readings are on time [s]."""
    rest_sigma: float = Field(0.001, gt=0)
    """Error of the position after 1 s, also at rest; grows with the root of the time [m per root s]."""
    rest_sigma_deg: float = Field(0.05, gt=0)
    """Error of the heading after 1 s, also at rest; grows with the root of the time [deg per root s]."""
    unmeasured_turn_deg: float | None = Field(20.0, gt=0)
    """Odometry that gives a distance only: the robot goes straight, give or take this turn after 1 m. null: nothing is
    said of turn and sideways motion [deg per root m]."""
    max_speed_mps: float = Field(10.0, gt=0)
    """A step that is faster is no motion but a restart of the odometry: lost, and begun anew [m/s]."""
    max_turn_dps: float = Field(720.0, gt=0)
    """The same of a turn, if it is more than 15 degrees [deg/s]."""
    max_gap_s: float = Field(2.0, gt=0)
    """A longer time without a reading is a gap. A shorter one is a gap if it is both longer than four usual times and
    longer than 0.25 s; where usual times are about as long as this or longer, four of them are the limit. The step
    across a gap counts where it is what the robot would have driven; else it is as wide as if it missed the way [s]."""


class ConstantSpeedConfig(PluginConfig):
    """A robot that drives on at a known speed, whatever it sees."""

    clock: Sensor["image", "rgbd", "scan", "odometry", "imu", "scalar"]
    """A sensor whose frames say what time it is; what they show is not looked at."""
    speed_mps: float
    """Speed; negative backwards [m/s]."""
    turn_deg_per_s: float = 0.0
    """Yaw rate, counter-clockwise [deg/s]."""
    distance_sigma: float = Field(0.3, gt=0)
    """Error of the distance after 1 s; grows with the root of the time [m per root s]."""
    lateral_sigma: float = Field(0.1, gt=0)
    """Error sideways after 1 s; grows with the root of the time [m per root s]."""
    turn_sigma_deg: float = Field(20.0, gt=0)
    """Error of the heading after 1 s; grows with the root of the time [deg per root s]."""
    max_gap_s: float = Field(1.0, gt=0)
    """A longer time without a frame is left as a gap: the recording may have stood still [s]."""

    @field_validator("speed_mps")
    @classmethod
    def _moves(cls, speed_mps: float) -> float:
        if speed_mps == 0.0:
            raise ValueError("must not be 0: a robot that stands needs no localizer")
        return speed_mps


class ImuConfig(PluginConfig):
    """What an inertial unit says of the heading. How it is mounted is the sensor's to say."""

    imu: Sensor["imu"]
    """The inertial unit."""
    turn_sigma_deg: float = Field(0.2, gt=0)
    """Error of the turn after 1 s; grows with the root of the time [deg per root s]."""
    bias_deg_per_s: float = 0.0
    """Rate that it shows at rest, about the vertical axis of base; taken off [deg/s]."""
    heading_sigma_deg: float | None = Field(None, gt=0)
    """Standard deviation of the absolute heading, where the unit has one; left out: it is not used [deg]."""
    north_deg: float = 0.0
    """Heading of the unit's zero in the map, counter-clockwise; added to the absolute heading [deg]."""
    max_gap_s: float = Field(0.5, gt=0)
    """Between readings farther apart the turn is not known: a gap is left [s]."""


class PoseFixesConfig(PluginConfig):
    """Absolute poses from elsewhere."""

    poses: Sensor["pose"]
    """The sensor of absolute poses, for example of a bag's PoseStamped or NavSatFix topic."""
    sigma: float | None = Field(None, gt=0)
    """Standard deviation of the place where the reading does not say, and at least this where it does [m]."""
    sigma_deg: float | None = Field(None, gt=0)
    """Standard deviation of the heading where the reading does not say, and at least this where it does [deg]."""
