"""From shifts in the picture to motion on the ground: Eqs. (3) and (4) of Nagai & Watanabe (2015).

In the picture v points down, so that a positive turn k, which takes (1, 0) to (cos k, -sin k), is
counter-clockwise on the screen. The camera's own axes are x along +u and y along -v; seen from above, as the
camera sees the ground, they are right-handed. The content of the picture moves against the camera.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Pose2

__all__ = ["ImageMotion", "combine", "ground_information", "pose_prev_now"]


@dataclass(frozen=True, slots=True)
class ImageMotion:
    """How the content of a picture moved: turned about a centre, then shifted.

    Attributes
    ----------
    u, v : float
        Shift [px].
    turn_rad : float
        Turn, counter-clockwise on the screen [rad].
    """

    u: float
    v: float
    turn_rad: float

    def about(self, offset_u: float, offset_v: float, aspect: float) -> ImageMotion:
        """Return the same motion about another centre, `offset` away from this one [px]."""
        cos, sin = math.cos(self.turn_rad), math.sin(self.turn_rad)
        return ImageMotion(
            self.u + cos * offset_u + sin * aspect * offset_v - offset_u,
            self.v + cos * offset_v - sin / aspect * offset_u - offset_v,
            self.turn_rad,
        )

    def array(self) -> Floats:
        """Return (u, v, turn_rad) as a (3,) array."""
        return np.array([self.u, self.v, self.turn_rad])


def combine(
    first: tuple[float, float], second: tuple[float, float], distance_px: float, aspect: float = 1.0
) -> ImageMotion:
    """Return the motion about the middle of two viewpoints from the shift of each, Eq. (3).

    Parameters
    ----------
    first, second : (float, float)
        Shift of each group, the first being the lower one (larger v) [px].
    distance_px : float
        D, the distance between the two centres of rotation [px].
    aspect : float
        Metres per pixel along v over those along u.
    """
    (u_1, v_1), (u_2, v_2) = first, second
    turn_rad = math.atan2(u_1 - u_2, aspect * (distance_px + v_1 - v_2))
    return ImageMotion((u_1 + u_2) / 2.0, (v_1 + v_2) / 2.0, turn_rad)


def pose_prev_now(motion: ImageMotion, metres_per_pixel: tuple[float, float]) -> Pose2:
    """Return the camera's motion between two pictures: one step of Eq. (4), in metres.

    Integrated by composition, which turns the shift by the heading after the turn: Eq. (1) turns first and then
    shifts. (As printed, with the heading before it, Eq. (4) tilts every step by the turn of that step.)

    Parameters
    ----------
    motion : ImageMotion
        About the middle of the picture.
    metres_per_pixel : (float, float)
        Along u and along v.
    """
    content_prev = Pose2(motion.u * metres_per_pixel[0], -motion.v * metres_per_pixel[1], motion.turn_rad)
    return content_prev.inverse()


def ground_information(
    information: Floats, pose_prev_now: Pose2, metres_per_pixel: tuple[float, float], pose_base_sensor: Pose2
) -> Floats:
    """Return the information of base's motion (x, y, theta) from that of the picture's (u, v, turn).

    Parameters
    ----------
    information : (3, 3) float64
        Of (u, v, turn) about the middle of the picture [1/px^2, 1/px^2, 1/rad^2 on the diagonal].
    pose_prev_now : Pose2
        The camera's motion.
    metres_per_pixel : (float, float)
        Along u and along v.
    pose_base_sensor : Pose2
        Mounting of the camera.
    """
    camera, mounting = pose_prev_now, pose_base_sensor
    cos_m, sin_m = math.cos(mounting.theta), math.sin(mounting.theta)
    cos, sin = math.cos(camera.theta), math.sin(camera.theta)
    # shift of the camera, t_s = R_m^T (t_b + R(theta) m - m): derivative with respect to the turn
    turned_x, turned_y = -sin * mounting.x - cos * mounting.y, cos * mounting.x - sin * mounting.y
    lever_x, lever_y = cos_m * turned_x + sin_m * turned_y, cos_m * turned_y - sin_m * turned_x
    # content of the picture, t_c = -R(-theta) t_s, and its derivative with respect to the turn
    slip_x = -(cos * lever_x + sin * lever_y) + sin * camera.x - cos * camera.y
    slip_y = -(cos * lever_y - sin * lever_x) + cos * camera.x + sin * camera.y
    cos_b, sin_b = math.cos(mounting.theta + camera.theta), math.sin(mounting.theta + camera.theta)
    along_u, along_v = metres_per_pixel
    jacobian = np.array(
        [
            [-cos_b / along_u, -sin_b / along_u, slip_x / along_u],
            [-sin_b / along_v, cos_b / along_v, -slip_y / along_v],
            [0.0, 0.0, -1.0],
        ]
    )
    product = jacobian.T @ information @ jacobian
    return np.asarray((product + product.T) / 2.0)
