"""Angles, counter-clockwise positive, wrapped to [-pi, pi)."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats

_TWO_PI = 2.0 * math.pi

__all__ = ["wrap_angle", "wrap_angles"]


def wrap_angle(angle_rad: float) -> float:
    """Return the angle wrapped to [-pi, pi); angles already there come back unchanged, bit for bit."""
    if -math.pi <= angle_rad < math.pi:
        return angle_rad
    wrapped = (angle_rad + math.pi) % _TWO_PI - math.pi
    return -math.pi if wrapped >= math.pi else wrapped  # the remainder can round up to 2 pi


def wrap_angles(angles_rad: npt.ArrayLike) -> Floats:
    """Return every angle of an array wrapped to [-pi, pi); shape unchanged."""
    wrapped = np.mod(np.asarray(angles_rad, dtype=np.float64) + np.pi, _TWO_PI) - np.pi
    return np.where(wrapped >= np.pi, -np.pi, wrapped)
