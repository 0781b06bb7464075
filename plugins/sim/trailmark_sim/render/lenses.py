"""Central cameras: what ray each pixel looks along, and on which pixel a point lands.

Directions are in the sensor's axes (x forward, y left, z up). The optical axes of the formulas are x right, y down,
z forward; a camera that looks straight up (`Catadioptric`) has its picture's top forward.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.frames import Pinhole

__all__ = ["Catadioptric", "Fisheye", "Lens", "PinholeLens"]

#: Optical axes in sensor axes: right is -y, down is -z, forward is x.
_SENSOR_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
#: Optical axes of a camera that looks up: with its top forward, right in the picture is left of the robot.
_SENSOR_UP = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_ENOUGH = 60


class Lens(ABC):
    """A central camera of some size.

    Attributes
    ----------
    width, height : int
        Of the picture [px].
    """

    width: int
    height: int

    @abstractmethod
    def directions(self) -> tuple[Floats, Bools]:
        """Return unit vectors (H, W, 3) in sensor axes, and which pixels show anything (H, W)."""

    @abstractmethod
    def project(self, points_sensor: Floats) -> Floats:
        """Return the pixels (N, 2) of points (N, 3) in sensor axes; NaN where they cannot be seen [px]."""

    def _grid(self) -> tuple[Floats, Floats]:
        v, u = np.mgrid[0.0 : self.height, 0.0 : self.width]
        return u, v


@dataclass(frozen=True, slots=True)
class PinholeLens(Lens):
    """A perspective camera with OpenCV's distortion.

    Attributes
    ----------
    width, height : int
        Size of the picture [px].
    calibration : Pinhole
        Focal lengths, centre and distortion.
    """

    width: int
    height: int
    calibration: Pinhole

    def directions(self) -> tuple[Floats, Bools]:
        c = self.calibration
        u, v = self._grid()
        distorted = np.stack([(u - c.cx) / c.fx, (v - c.cy) / c.fy], axis=-1)
        ideal = distorted.copy()
        if any(c.distortion):
            for _ in range(_ENOUGH):  # a fixed point: the distortion of lenses contracts
                ideal -= self._distort(ideal) - distorted
        rays = np.concatenate([ideal, np.ones_like(u)[..., None]], axis=-1) @ _SENSOR_OPTICAL.T
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True), np.ones(u.shape, np.bool_)

    def project(self, points_sensor: Floats) -> Floats:
        c = self.calibration
        optical = points_sensor @ _SENSOR_OPTICAL
        depth = np.where(optical[:, 2:] > 0.0, optical[:, 2:], np.nan)
        plane = self._distort(optical[:, :2] / depth)
        return np.asarray(plane * (c.fx, c.fy) + (c.cx, c.cy))

    def _distort(self, ideal: Floats) -> Floats:
        k1, k2, p1, p2, k3, k4, k5, k6 = (*self.calibration.distortion, *[0.0] * 8)[:8]
        x, y = ideal[..., 0], ideal[..., 1]
        r2 = x * x + y * y
        radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        dx = 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        dy = p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.stack([x * radial + dx, y * radial + dy], axis=-1)


@dataclass(frozen=True, slots=True)
class Fisheye(Lens):
    """A lens whose radius grows with the angle: ``r = f (a + k1 a^3 + k2 a^5)`` (Kannala & Brandt 2006, Eq. (1)).

    Attributes
    ----------
    focal_px, cx, cy : float
        Focal length and principal point [px].
    k : (float, float)
        k1 and k2; growing with the angle up to `half_angle_rad`.
    half_angle_rad : float
        What it sees on each side of its axis [rad].
    """

    width: int
    height: int
    focal_px: float
    cx: float
    cy: float
    k: tuple[float, float] = (0.0, 0.0)
    half_angle_rad: float = math.radians(90.0)

    def directions(self) -> tuple[Floats, Bools]:
        u, v = self._grid()
        x, y = u - self.cx, v - self.cy
        radius = np.hypot(x, y)
        angle = _inverse(self._radius, radius, self.half_angle_rad)
        shows = radius <= float(self._radius(np.array(self.half_angle_rad)))
        return _around_axis(x, y, radius, angle) @ _SENSOR_OPTICAL.T, shows

    def project(self, points_sensor: Floats) -> Floats:
        x, y, z = (points_sensor @ _SENSOR_OPTICAL).T
        across = np.hypot(x, y)
        angle = np.arctan2(across, z)
        radius = np.where(angle <= self.half_angle_rad, self._radius(angle), np.nan)
        share = radius / np.maximum(across, 1e-12)
        return np.stack([self.cx + share * x, self.cy + share * y], axis=1)

    def _radius(self, angle: Floats) -> Floats:
        square = angle * angle
        return np.asarray(self.focal_px * angle * (1.0 + square * (self.k[0] + square * self.k[1])))


@dataclass(frozen=True, slots=True)
class Catadioptric(Lens):
    """A camera that looks up into a mirror: ``r = f sin(a) / (cos(a) + xi)``, `a` the angle from straight down.

    The unified model of central mirrors (Geyer & Daniilidis 2000); `xi` of 1 is a parabolic mirror. The top of the
    picture shows what is before the robot, and bearings turn clockwise in it.

    Attributes
    ----------
    focal_px, xi : float
        Scale [px] and shape of the mirror.
    cx, cy : float
        Middle of the mirror [px].
    inner_px, outer_px : float
        The ring that shows the surroundings; within it stands the camera itself [px].
    """

    width: int = 320
    height: int = 240
    focal_px: float = 60.0
    xi: float = 0.9
    cx: float = 159.5
    cy: float = 119.5
    inner_px: float = 22.0
    outer_px: float = 114.0

    def directions(self) -> tuple[Floats, Bools]:
        u, v = self._grid()
        x, y = u - self.cx, v - self.cy
        radius = np.hypot(x, y)
        angle = _inverse(self._radius, radius, self._most)
        rays = _around_axis(x, y, radius, angle) * (1.0, 1.0, -1.0)  # angles count from straight down
        return rays @ _SENSOR_UP.T, (radius >= self.inner_px) & (radius <= self.outer_px)

    def project(self, points_sensor: Floats) -> Floats:
        x, y, z = (points_sensor @ _SENSOR_UP).T
        across = np.hypot(x, y)
        angle = np.arctan2(across, -z)
        radius = self._radius(np.minimum(angle, self._most))
        radius[(angle > self._most) | (radius < self.inner_px) | (radius > self.outer_px)] = np.nan
        share = radius / np.maximum(across, 1e-12)
        return np.stack([self.cx + share * x, self.cy + share * y], axis=1)

    @property
    def _most(self) -> float:
        return math.acos(max(-1.0, -self.xi)) - 0.15

    def _radius(self, angle: Floats) -> Floats:
        return np.asarray(self.focal_px * np.sin(angle) / (np.cos(angle) + self.xi))


def _around_axis(x: Floats, y: Floats, radius: Floats, angle: Floats) -> Floats:
    share = np.sin(angle) / np.maximum(radius, 1e-12)
    return np.stack([x * share, y * share, np.cos(angle)], axis=-1)


def _inverse(radius_of: Callable[[Floats], Floats], radius: Floats, most_rad: float) -> Floats:
    """Return the angle at which a growing function of the angle has a value, by halving."""
    low, high = np.zeros_like(radius), np.full_like(radius, most_rad)
    for _ in range(_ENOUGH):
        middle = (low + high) / 2.0
        is_beyond = radius_of(middle) > radius
        low, high = np.where(is_beyond, low, middle), np.where(is_beyond, middle, high)
    return (low + high) / 2.0
