"""From Trailmark's axes to those of MAVLink.

Trailmark: map and base have x forward, y left, z up, angles counter-clockwise. MAVLink's FRD has x forward, y right, z
down, angles clockwise seen from above; NED is FRD with x to the north.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from trailmark.geometry import Pose2

__all__ = ["covariance_21", "pose_frd", "pose_ned"]

Floats = npt.NDArray[np.float64]

#: Variance of height, roll and pitch of a robot on a floor [m^2, rad^2].
_FLAT = 1e-4
#: Places of x, y and yaw among the six.
_PLANAR = np.ix_((0, 1, 5), (0, 1, 5))


def pose_frd(pose: Pose2) -> tuple[float, float, float]:
    """Return x [m], y [m] and yaw [rad] of a pose of the map in the frame FRD of the same origin and x axis."""
    return pose.x, -pose.y, -pose.theta


def pose_ned(pose: Pose2, north_rad: float) -> tuple[float, float, float]:
    """Return north [m], east [m] and yaw from north, clockwise [rad].

    Parameters
    ----------
    pose : Pose2
        In the map.
    north_rad : float
        Direction of north in the map, counter-clockwise from its x axis.
    """
    cos, sin = math.cos(north_rad), math.sin(north_rad)
    yaw_rad = math.remainder(north_rad - pose.theta, 2.0 * math.pi)
    return cos * pose.x + sin * pose.y, sin * pose.x - cos * pose.y, yaw_rad


def covariance_21(covariance: Floats | None, north_rad: float = 0.0) -> list[float]:
    """Return the upper triangle of a covariance of x, y, z, roll, pitch, yaw, row by row; NaN first: not known.

    Parameters
    ----------
    covariance : (3, 3) float64 or None
        Of x, y and theta, in axes of the map.
    north_rad : float
        Direction of the new x axis in the map; 0 for FRD.
    """
    if covariance is None:
        return [math.nan] + [0.0] * 20
    cos, sin = math.cos(north_rad), math.sin(north_rad)
    turn = np.array([[cos, sin, 0.0], [sin, -cos, 0.0], [0.0, 0.0, -1.0]])
    six = np.diag([_FLAT] * 6)
    six[_PLANAR] = turn @ covariance @ turn.T
    return [float(value) for value in six[np.triu_indices(6)]]
