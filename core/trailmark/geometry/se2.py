"""SE(2): poses and twists in the plane, and angles: counter-clockwise positive, wrapped to [-pi, pi)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import ShapeError

__all__ = ["Pose2", "Twist2", "rotate_axes", "wrap_angle", "wrap_angles"]

_TWO_PI = 2.0 * math.pi

# Below this angle sin(a)/a and (1-cos(a))/a come from their series: the closed forms lose digits.
_SMALL_ANGLE_RAD = 1e-6


@dataclass(frozen=True, slots=True, init=False)
class Pose2:
    """A pose in the plane, or the transform that it stands for.

    ``pose_a_b`` takes coordinates in b to coordinates in a: ``point_a = pose_a_b @ point_b``,
    and neighbours cancel: ``pose_a_c = pose_a_b @ pose_b_c``.

    Attributes
    ----------
    x, y : float
        Position [m].
    theta : float
        Heading, counter-clockwise, wrapped to [-pi, pi) [rad].

    Raises
    ------
    ValueError
        If a number is not finite: an unknown pose is ``None``, never NaN.
    """

    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0

    def __init__(self, x: float = 0.0, y: float = 0.0, theta: float = 0.0) -> None:  # thirty times a frame: by hand
        if not (-math.pi <= theta < math.pi and math.isfinite(x) and math.isfinite(y)):
            if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(theta)):
                raise ValueError(f"pose is not finite: x={x}, y={y}, theta={theta}")
            theta = wrap_angle(theta)
        _set_x(self, x)
        _set_y(self, y)
        _set_theta(self, theta)

    @overload
    def __matmul__(self, other: Pose2) -> Pose2: ...
    @overload
    def __matmul__(self, other: Floats) -> Floats: ...
    def __matmul__(self, other: Pose2 | Floats) -> Pose2 | Floats:
        """Compose with a pose, or transform points of shape (2,) or (N, 2) [m]."""
        cos, sin = math.cos(self.theta), math.sin(self.theta)
        if isinstance(other, Pose2):
            return Pose2(
                self.x + cos * other.x - sin * other.y,
                self.y + sin * other.x + cos * other.y,
                self.theta + other.theta,
            )
        points = np.asarray(other, dtype=np.float64)
        if points.shape[-1:] != (2,):
            raise ShapeError(f"points must have shape (2,) or (N, 2), not {points.shape}")
        rotation_transposed = np.array([[cos, sin], [-sin, cos]])
        return np.asarray(points @ rotation_transposed + (self.x, self.y))

    def inverse(self) -> Pose2:
        """Return ``pose_b_a`` of ``pose_a_b``."""
        cos, sin = math.cos(self.theta), math.sin(self.theta)
        return Pose2(-cos * self.x - sin * self.y, sin * self.x - cos * self.y, -self.theta)

    def between(self, other: Pose2) -> Pose2:
        """Return `other` as seen from here: ``pose_a_b.between(pose_a_c) == pose_b_c``."""
        cos, sin = math.cos(self.theta), math.sin(self.theta)
        dx, dy = other.x - self.x, other.y - self.y
        return Pose2(cos * dx + sin * dy, cos * dy - sin * dx, other.theta - self.theta)

    def moved_as(self, before: Pose2, after: Pose2) -> Pose2:
        """Return ``self @ before.between(after)``, in half the time: this pose moved as another one has moved."""
        cos, sin = math.cos(before.theta), math.sin(before.theta)
        dx, dy = after.x - before.x, after.y - before.y
        x, y = cos * dx + sin * dy, cos * dy - sin * dx
        cos, sin = math.cos(self.theta), math.sin(self.theta)
        turn = wrap_angle(after.theta - before.theta)
        return Pose2(self.x + cos * x - sin * y, self.y + sin * x + cos * y, self.theta + turn)

    def distance_to(self, other: Pose2) -> float:
        """Return the distance between the two positions [m]."""
        return math.hypot(other.x - self.x, other.y - self.y)

    def interpolate(self, other: Pose2, fraction: float) -> Pose2:
        """Return the pose at `fraction` of the way to `other`: straight line, shortest turn."""
        return Pose2(
            self.x + fraction * (other.x - self.x),
            self.y + fraction * (other.y - self.y),
            self.theta + fraction * wrap_angle(other.theta - self.theta),
        )

    def adjoint(self) -> Floats:
        """Return the (3, 3) adjoint: ``twist_a = pose_a_b.adjoint() @ twist_b``, twists as (x, y, theta)."""
        cos, sin = math.cos(self.theta), math.sin(self.theta)
        return np.array([[cos, -sin, self.y], [sin, cos, -self.x], [0.0, 0.0, 1.0]])

    def matrix(self) -> Floats:
        """Return the homogeneous (3, 3) matrix."""
        cos, sin = math.cos(self.theta), math.sin(self.theta)
        return np.array([[cos, -sin, self.x], [sin, cos, self.y], [0.0, 0.0, 1.0]])

    def array(self) -> Floats:
        """Return (x, y, theta) as a (3,) array [m, m, rad]."""
        return np.array([self.x, self.y, self.theta])

    @classmethod
    def from_array(cls, values: npt.ArrayLike | Sequence[float]) -> Pose2:
        """Return the pose of an array (x, y, theta) [m, m, rad].

        Raises
        ------
        ShapeError
            If there are not three numbers.
        """
        array = np.asarray(values, dtype=np.float64)
        if array.shape != (3,):
            raise ShapeError(f"a pose has three numbers (x, y, theta), not shape {array.shape}")
        return cls(float(array[0]), float(array[1]), float(array[2]))

    @classmethod
    def exp(cls, forward_m: float, left_m: float, turn_rad: float) -> Pose2:
        """Return the motion of a constant twist: the arc, not the chord (the exponential of SE(2)).

        Parameters
        ----------
        forward_m, left_m : float
            Distance driven along the moving body's own axes [m].
        turn_rad : float
            Turn while driving it [rad].
        """
        if abs(turn_rad) < _SMALL_ANGLE_RAD:
            sine, cosine = 1.0 - turn_rad * turn_rad / 6.0, turn_rad / 2.0
        else:
            sine = math.sin(turn_rad) / turn_rad
            cosine = 2.0 * math.sin(turn_rad / 2.0) ** 2 / turn_rad  # (1 - cos a) / a, without the cancellation
        return cls(sine * forward_m - cosine * left_m, cosine * forward_m + sine * left_m, turn_rad)

    def log(self) -> tuple[float, float, float]:
        """Return the constant twist (forward_m, left_m, turn_rad) whose `exp` is this pose."""
        half = self.theta / 2.0
        scale = 1.0 - half * half / 3.0 if abs(self.theta) < _SMALL_ANGLE_RAD else half / math.tan(half)
        return scale * self.x + half * self.y, scale * self.y - half * self.x, self.theta


# A frozen class sets its fields past itself; by their slots that takes half the time of `object.__setattr__`.
_set_x, _set_y, _set_theta = (vars(Pose2)[name].__set__ for name in ("x", "y", "theta"))


@dataclass(frozen=True, slots=True, init=False)
class Twist2:
    """Velocity of a body in the plane, along its own axes.

    Attributes
    ----------
    forward_mps, left_mps : float
        Velocity along x (forward) and y (left) of the body [m/s].
    yaw_radps : float
        Yaw rate, counter-clockwise [rad/s].
    """

    forward_mps: float = 0.0
    left_mps: float = 0.0
    yaw_radps: float = 0.0

    def __init__(self, forward_mps: float = 0.0, left_mps: float = 0.0, yaw_radps: float = 0.0) -> None:
        _set_forward(self, forward_mps)
        _set_left(self, left_mps)
        _set_yaw(self, yaw_radps)

    def after(self, dt_s: float) -> Pose2:
        """Return the motion when the twist holds for `dt_s` seconds."""
        return Pose2.exp(self.forward_mps * dt_s, self.left_mps * dt_s, self.yaw_radps * dt_s)


_set_forward, _set_left, _set_yaw = (vars(Twist2)[name].__set__ for name in ("forward_mps", "left_mps", "yaw_radps"))


def wrap_angle(angle_rad: float) -> float:
    """Return the angle wrapped to [-pi, pi); angles already there come back unchanged, bit for bit.

    Parameters
    ----------
    angle_rad : float
        Any angle [rad].

    Returns
    -------
    float
        The same direction in [-pi, pi) [rad].
    """
    if -math.pi <= angle_rad < math.pi:
        return angle_rad
    wrapped = (angle_rad + math.pi) % _TWO_PI - math.pi
    return -math.pi if wrapped >= math.pi else wrapped  # the remainder can round up to 2 pi


def wrap_angles(angles_rad: npt.ArrayLike) -> Floats:
    """Return every angle of an array wrapped to [-pi, pi); shape unchanged.

    Parameters
    ----------
    angles_rad : array_like
        Angles of any shape [rad].

    Returns
    -------
    float64 array
        The same directions in [-pi, pi) [rad].
    """
    wrapped = np.mod(np.asarray(angles_rad, dtype=np.float64) + np.pi, _TWO_PI) - np.pi
    return np.where(wrapped >= np.pi, -np.pi, wrapped)


def rotate_axes(matrix: Floats, angle_rad: float) -> Floats:
    """Return a covariance or information of (x, y, theta) in other axes.

    Parameters
    ----------
    matrix : (3, 3) float64
        Covariance or information in the old axes.
    angle_rad : float
        Heading of the old axes in the new ones [rad].

    Returns
    -------
    (3, 3) float64
        The matrix in the new axes, symmetric to the last bit.
    """
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    rotated = turn @ matrix @ turn.T
    return np.asarray((rotated + rotated.T) / 2.0)
