"""Eqs. (7)-(16) of Toth et al. (2015), with the paper's names.

Axes of the paper: x to the right of the colour camera's axis, V away from the camera (perpendicular distance), y up.
Angles are signed here, right and up positive, so that two landmarks may lie on one side of the axis; the paper counts
both outwards, which is the same where A is left and B is right of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.frames import Pinhole
from trailmark.geometry import Pose2

__all__ = [
    "Abscissa",
    "AngleModel",
    "DepthKind",
    "Sights",
    "abscissa",
    "epsilon",
    "pixel_angles",
    "planar_range",
    "sights",
]

DepthKind = Literal["z", "range"]
AngleModel = Literal["pinhole", "linear"]


@dataclass(frozen=True, slots=True, eq=False)
class Sights:
    """Landmarks as the camera sees them.

    Attributes
    ----------
    alpha, beta : (N,) float64
        Angles from the colour camera's axis, to the right and upwards [rad].
    dM : (N,) float64
        Distances as the depth sensor measured them [m].
    dx, dV, dy : (N,) float64
        Distance to the right of the axis, from the camera's plane, and above the axis [m].
    """

    alpha: Floats
    beta: Floats
    dM: Floats
    dx: Floats
    dV: Floats
    dy: Floats

    def points_sensor(self) -> Floats:
        """Return the landmarks in sensor axes (x forward, y left, z up), (N, 3) [m]."""
        return np.stack([self.dV, -self.dx, self.dy], axis=-1)


@dataclass(frozen=True, slots=True)
class Abscissa:
    """The line from landmark A to landmark B, as the camera sees it.

    Attributes
    ----------
    AB : float
        Distance of the two, Eq. (13) [m].
    omega : float
        Angle between the line and the camera's plane, Eq. (14), never negative [rad].
    Dir : float
        ``dV_A - dV_B``, Eq. (15) as printed [m].
    """

    AB: float
    omega: float
    Dir: float

    @property
    def side(self) -> Literal["left", "right", "middle"]:
        """On which side of the perpendicular bisector of AB a robot stands that faces its middle.

        Differs from the paper: its text calls the case "A is far away" negative, but Eq. (15) is positive there.
        """
        if self.Dir == 0.0:
            return "middle"
        return "right" if self.Dir > 0.0 else "left"


def pixel_angles(
    uv: Floats, lens: Pinhole, size: tuple[int, int], model: AngleModel = "pinhole"
) -> tuple[Floats, Floats]:
    """Return the angles alpha and beta of pixels.

    Parameters
    ----------
    uv : (N, 2) float
        Pixels (u, v) [px].
    lens : Pinhole
        The colour camera.
    size : (int, int)
        Width and height of the picture [px].
    model : {"pinhole", "linear"}
        The camera's geometry, or the paper's "counting pixels": the share of half the width times half the capture
        angle, up to 0.94 deg off at 57 deg.

    Returns
    -------
    (N,), (N,) float64
        alpha, right positive, and beta, up positive [rad].
    """
    uv = np.asarray(uv, dtype=np.float64).reshape(-1, 2)
    if model == "linear":
        half_u_rad = math.atan(size[0] / 2.0 / lens.fx)
        half_v_rad = math.atan(size[1] / 2.0 / lens.fy)
        alpha = (uv[:, 0] - lens.cx) / (size[0] / 2.0) * half_u_rad
        return alpha, -(uv[:, 1] - lens.cy) / (size[1] / 2.0) * half_v_rad
    normal = _undistort(uv, lens)
    return np.arctan(normal[:, 0]), -np.arctan(normal[:, 1])


def _undistort(uv: Floats, lens: Pinhole) -> Floats:
    """Return pixels on the plane one metre before the camera, (N, 2)."""
    if not lens.distortion or len(uv) == 0:
        return np.asarray((uv - (lens.cx, lens.cy)) / (lens.fx, lens.fy))
    import cv2

    found = cv2.undistortPoints(uv.reshape(-1, 1, 2), lens.matrix(), np.array(lens.distortion))
    return np.asarray(found.reshape(-1, 2), dtype=np.float64)


def planar_range(ray_m: npt.ArrayLike, alpha: npt.ArrayLike, beta: npt.ArrayLike) -> Floats:
    """Return the part in the plane of alpha of a distance along a ray in space, (N,) [m].

    The paper's Figure 3 looks from above, so its dM lies in that plane; a sensor measures along the ray.
    """
    tan_a, tan_b = np.tan(np.asarray(alpha, float)), np.tan(np.asarray(beta, float))
    cos_a = 1.0 / np.sqrt(1.0 + tan_a * tan_a)
    return np.asarray(np.asarray(ray_m, float) / np.sqrt(1.0 + tan_a**2 + tan_b**2) / cos_a)


def sights(alpha: npt.ArrayLike, beta: npt.ArrayLike, dM: npt.ArrayLike, depth_kind: DepthKind = "z") -> Sights:
    """Return where landmarks stand before the camera, Eqs. (7)-(12).

    Parameters
    ----------
    alpha, beta : (N,) float
        Angles to the right and upwards [rad].
    dM : (N,) float
        Measured distances [m].
    depth_kind : {"z", "range"}
        ``range``: along the line of sight, as Eqs. (7)-(10) are printed. ``z``: from the camera's plane, as the
        Kinect and its kin give it; the printed equations are then 12 % wrong at the image edge.
    """
    a, b, d = (np.atleast_1d(np.asarray(value, dtype=np.float64)) for value in (alpha, beta, dM))
    if depth_kind == "range":
        dx, dV = d * np.sin(a), d * np.cos(a)  # Eqs. (7)-(10)
    else:
        dx, dV = d * np.tan(a), d  # Differs from the paper: dM is already perpendicular
    return Sights(a, b, d, dx, dV, dV * np.tan(b))  # Eqs. (11), (12)


def abscissa(dx_A: float, dV_A: float, dx_B: float, dV_B: float) -> Abscissa:
    """Return length and turn of the line AB, Eqs. (13)-(15).

    Parameters
    ----------
    dx_A, dx_B : float
        To the right of the camera's axis; with A left of it, ``dx_B - dx_A`` is the paper's sum of the two
        outward distances [m].
    dV_A, dV_B : float
        From the camera's plane [m].
    """
    across, along = dx_B - dx_A, dV_A - dV_B
    return Abscissa(math.hypot(across, along), math.atan2(abs(along), abs(across)), along)


def epsilon(pose_start_now: Pose2) -> float:
    """Return the length of the way from the start, Eq. (16) [m]."""
    return math.hypot(pose_start_now.x, pose_start_now.y)
