"""The pose that measurements rejected of late agree on.

If they agree on one, it may be the belief that is wrong.

A start that is wrong and overconfident rejects the truth. One rejected estimate of rank two does not say where base is,
and to take it with an inflated covariance puts the belief anywhere on a circle. So the rejected ones are kept, each
with where odometry stood, and the one pose is sought from which all of them are as they should be.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.state import RejectedMeasurement
from trailmark.geometry import Pose2, wrap_angle

__all__ = ["agreed_pose", "directions_of"]

# Headings from which the search begins, besides the believed one: the cost has several valleys.
_TURNS = (0.0, math.pi / 2.0, math.pi, -math.pi / 2.0)
_STEPS = 8
_SETTLED = 1e-4
# Beyond this many standard deviations a measurement weighs less; it was made with a belief that is wrong.
_SCALE = 3.0
# This share of the rejected must agree on the pose, within this many sigmas a direction.
_SHARE, _SIGMAS = 0.7, 4.0
# What a belief that is wrong still says of the position: not much, but where landmarks stand in one direction it keeps
# the pose near. Of the heading it says nothing, and a pose whose heading is less certain than this is none [m, rad].
_NEAR_M, _LEAST_RAD = 3.0, 0.5


def agreed_pose(rejected: Sequence[RejectedMeasurement], odom: Pose2, believed: Floats) -> tuple[Floats, Floats] | None:
    """Return the pose that rejected measurements agree on, and its covariance; None if they do not.

    Parameters
    ----------
    rejected : sequence of RejectedMeasurement
        The measurements.
    odom : Pose2
        Where odometry stands now.
    believed : (n,) float64
        The belief now; the search begins at its position.

    Returns
    -------
    ((3,) float64, (3, 3) float64) or None
        The covariance is scaled by how well they fit, never below what they state.
    """
    ways = [odom.between(one.pose_odom_base) for one in rejected]
    fits = [_fit_pose(rejected, ways, believed, turn) for turn in _TURNS]
    _, x, information = min(fits, key=lambda fit: fit[0])
    covariance: Floats = np.asarray(np.linalg.inv(information + 1e-9 * np.eye(3)))
    if covariance[2, 2] > _LEAST_RAD**2:
        return None
    squares, dofs = _residuals(rejected, ways, x)
    agree = squares <= _SIGMAS * _SIGMAS * dofs
    dof = int(dofs[agree].sum()) - 3
    if agree.mean() < _SHARE or dof <= 0:
        return None
    spread = max(1.0, float(squares[agree].sum()) / dof)
    return x, spread * covariance


def directions_of(rejected: Sequence[RejectedMeasurement], odom: Pose2, believed: Floats) -> int:
    """Return how many directions of the pose rejected measurements have together, carried to where odometry stands.

    A place measured twice on a way tells the heading, too.
    """
    rows = np.vstack([_innovation_of(one, odom.between(one.pose_odom_base), believed[:3])[1] for one in rejected])
    return int(np.linalg.matrix_rank(rows / np.linalg.norm(rows, axis=1, keepdims=True), tol=1e-3))


def _fit_pose(
    rejected: Sequence[RejectedMeasurement], ways: Sequence[Pose2], believed: Floats, turn: float
) -> tuple[float, Floats, Floats]:
    """Return cost, pose and information of a robust least-squares fit (Gauss-Newton with Cauchy weights)."""
    x = np.array([believed[0], believed[1], wrap_angle(float(believed[2]) + turn)])
    for _ in range(_STEPS):
        information, moment, cost = _normal_equations(rejected, ways, believed, x)
        step = np.linalg.solve(information + 1e-9 * np.eye(3), moment)
        x = x + step
        x[2] = wrap_angle(float(x[2]))
        if np.abs(step).max() < _SETTLED:
            break
    information, _, cost = _normal_equations(rejected, ways, believed, x)
    return cost, x, information


def _normal_equations(
    rejected: Sequence[RejectedMeasurement], ways: Sequence[Pose2], believed: Floats, x: Floats
) -> tuple[Floats, Floats, float]:
    near = np.diag([_NEAR_M**-2, _NEAR_M**-2, 0.0])
    away = near @ (believed[:3] - x)
    information, moment, cost = near, away, 0.5 * float(away @ (believed[:3] - x))
    for one, way in zip(rejected, ways):
        innovation, jacobian = _innovation_of(one, way, x)
        distance2 = float(innovation @ innovation) / (len(innovation) * _SCALE * _SCALE)
        weight = 1.0 / (1.0 + distance2)
        information = information + weight * jacobian.T @ jacobian
        moment = moment + weight * jacobian.T @ innovation
        cost += math.log1p(distance2)
    return information, moment, cost


def _residuals(rejected: Sequence[RejectedMeasurement], ways: Sequence[Pose2], x: Floats) -> tuple[Floats, Floats]:
    seen = [_innovation_of(one, way, x)[0] for one, way in zip(rejected, ways)]
    return np.array([float(one @ one) for one in seen]), np.array([len(one) for one in seen])


def _innovation_of(one: RejectedMeasurement, way: Pose2, x: Floats) -> tuple[Floats, Floats]:
    """Return innovation and Jacobian of a rejected measurement, of the pose now."""
    px, py, theta = x.tolist()
    cos, sin = math.cos(theta), math.sin(theta)
    dx, dy = cos * way.x - sin * way.y, sin * way.x + cos * way.y
    then = np.array([px + dx, py + dy, wrap_angle(theta + way.theta)])
    innovation, jacobian = one.measurement.innovation(then)
    turned = jacobian.copy()
    turned[:, 2] += jacobian[:, 1] * dx - jacobian[:, 0] * dy
    return innovation, turned
