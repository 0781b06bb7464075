"""Absolute poses in ROS messages as readings: stamped poses and satellite fixes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from trailmark.frames import Record
from trailmark.sources.ros_messages import planar_pose

__all__ = ["POSE_TYPES", "SATELLITE", "LocalPlane", "has_fix", "pose_record"]

SATELLITE = "sensor_msgs/msg/NavSatFix"

#: Types of messages that hold an absolute pose; they are read where the config names their topic.
POSE_TYPES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped", SATELLITE)

# WGS 84
_EQUATOR_M, _ECCENTRICITY_SQUARED = 6_378_137.0, 6.694_379_990_14e-3
_PLANAR = np.ix_((0, 1, 5), (0, 1, 5))  # x, y and yaw of the six of a covariance


@dataclass(slots=True)
class LocalPlane:
    """The plane that touches the ellipsoid of WGS 84 at the first place it is asked about: x east, y north.

    Its scale is that of the first place: 10 km away distances are short by about one in a thousand.

    Attributes
    ----------
    origin_deg : (float, float) or None
        Latitude and longitude of the first place [deg]; None before it.
    """

    origin_deg: tuple[float, float] | None = None

    def place(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Return x and y [m] of a place."""
        if self.origin_deg is None:
            self.origin_deg = (latitude_deg, longitude_deg)
        latitude_0, longitude_0 = self.origin_deg
        sine = math.sin(math.radians(latitude_0))
        flattened = 1.0 - _ECCENTRICITY_SQUARED * sine * sine
        east_radius_m = _EQUATOR_M / math.sqrt(flattened) * math.cos(math.radians(latitude_0))
        north_radius_m = _EQUATOR_M * (1.0 - _ECCENTRICITY_SQUARED) / flattened**1.5
        turn_deg = math.remainder(longitude_deg - longitude_0, 360.0)
        return east_radius_m * math.radians(turn_deg), north_radius_m * math.radians(latitude_deg - latitude_0)


def has_fix(message: Any) -> bool:
    """Return whether a message knows a place: a satellite receiver may not."""
    if not hasattr(message, "latitude"):
        return True
    return bool(message.status.status >= 0 and math.isfinite(message.latitude) and math.isfinite(message.longitude))


def pose_record(message: Any, plane: LocalPlane) -> Record:
    """Return an absolute pose as a record of kind ``pose``.

    Returns
    -------
    Record
        ``pose``: (3,) x, y [m] and heading [rad] of what carries the sensor. ``covariance``: (3, 3) of them, infinite
        where nothing is known of a number, and NaN where the message does not say how exact it is.

    Raises
    ------
    ValueError
        If a number is missing, or an orientation is none.
    """
    if hasattr(message, "latitude"):
        return _satellite_record(message, plane)
    has_covariance = hasattr(message.pose, "covariance")
    pose = planar_pose(message.pose.pose if has_covariance else message.pose)
    covariance = np.full((3, 3), np.nan)
    if has_covariance:
        told = np.asarray(message.pose.covariance, float).reshape(6, 6)[_PLANAR]
        covariance = told if np.all(np.diag(told) > 0.0) else covariance
    return Record({"pose": pose.array(), "covariance": covariance})


def _satellite_record(message: Any, plane: LocalPlane) -> Record:
    x, y = plane.place(float(message.latitude), float(message.longitude))
    covariance = np.diag([np.nan, np.nan, np.inf])  # a receiver does not know where it heads
    told = np.asarray(message.position_covariance, float).reshape(3, 3)[:2, :2]
    if message.position_covariance_type > 0 and np.all(np.diag(told) > 0.0):
        covariance[:2, :2] = told
    return Record({"pose": np.array([x, y, 0.0]), "covariance": covariance})
