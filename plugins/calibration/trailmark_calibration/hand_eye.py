"""Closed forms: the place of a sensor from motions of base and sensor, with or without the scale of the way.

``A X = X B`` in the plane: `A` is a motion of base, `B` the same motion as the sensor sees it, `X` the sensor on base.
The turns of both are equal. What is left is linear in ``(x, y, cos yaw, sin yaw)`` and in the scale of the way of A:
a least-squares problem with one quadratic constraint (Censi, Marchionni, Oriolo 2008; Censi, Franchi, Marchionni,
Oriolo 2013, Sec. V), whose best solution is an eigenvector.
"""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import DataError, ShapeError
from trailmark.geometry import Pose2

__all__ = ["solve_hand_eye", "solve_hand_eye_and_scale"]

#: Less turn than this in all leaves x and y free [rad].
_LEAST_TURN_RAD = 1e-6


def solve_hand_eye(motions_base: Floats, motions_sensor: Floats, weights: Floats | None = None) -> Pose2:
    """Return the place of the sensor on base, ``X`` of ``A X = X B``.

    Parameters
    ----------
    motions_base, motions_sensor : (N, 3) float64
        Relative poses over the same intervals [m, m, rad].
    weights : (N,) float64, optional
        Of each pair; default: equal.

    Raises
    ------
    DataError
        If the motions do not determine it: without turns x and y stay free, without ways the yaw.
    """
    solution = _solve(motions_base, motions_sensor, weights, is_scale_free=False)
    return Pose2(float(solution[0]), float(solution[1]), math.atan2(solution[3], solution[2]))


def solve_hand_eye_and_scale(
    motions_base: Floats, motions_sensor: Floats, weights: Floats | None = None
) -> tuple[Pose2, float]:
    """Return the place of the sensor and the factor of the way of base, ``(scaled A) X = X B``.

    A drive with a sensor that sits the other way round is the same as one whose way counts backwards: the factor is
    returned positive.

    Parameters
    ----------
    motions_base, motions_sensor : (N, 3) float64
        Relative poses over the same intervals [m, m, rad].
    weights : (N,) float64, optional
        Of each pair; default: equal.

    Raises
    ------
    DataError
        If the motions do not determine them.
    """
    solution = _solve(motions_base, motions_sensor, weights, is_scale_free=True)
    solution = solution if solution[4] >= 0.0 else -solution
    return Pose2(float(solution[0]), float(solution[1]), math.atan2(solution[3], solution[2])), float(solution[4])


def _solve(base: Floats, sensor: Floats, weights: Floats | None, *, is_scale_free: bool) -> Floats:
    """Return (x, y, cos, sin, scale) of least error, cos and sin of length one."""
    base, sensor = np.asarray(base, dtype=np.float64), np.asarray(sensor, dtype=np.float64)
    if base.shape != sensor.shape or base.ndim != 2 or base.shape[1:] != (3,):
        raise ShapeError(f"motions are two (N, 3) arrays of one length, not {base.shape} and {sensor.shape}")
    root = np.ones(len(base)) if weights is None else np.sqrt(np.asarray(weights, dtype=np.float64))
    if np.abs(sensor[:, 2] * root).sum() < _LEAST_TURN_RAD:
        raise DataError("the motions have no turn: the place of the sensor cannot be told from them")
    # (R - I) t_X + scale t_A - R_X t_B = 0
    cos, sin = np.cos(sensor[:, 2]), np.sin(sensor[:, 2])
    first = np.stack([cos - 1.0, -sin, -sensor[:, 0], sensor[:, 1], base[:, 0]], axis=1)
    second = np.stack([sin, cos - 1.0, -sensor[:, 1], -sensor[:, 0], base[:, 1]], axis=1)
    rows = np.concatenate([first * root[:, None], second * root[:, None]])
    return _of_free_scale(rows) if is_scale_free else _of_known_scale(rows)


def _of_free_scale(rows: Floats) -> Floats:
    """Minimise ``|rows q|`` with cos^2 + sin^2 = 1: the others follow from cos and sin, which are an eigenvector."""
    turned, others = rows[:, 2:4], rows[:, [0, 1, 4]]
    if np.linalg.matrix_rank(others, tol=1e-9 * max(1.0, float(np.abs(others).max())) * len(rows)) < 3:
        raise DataError("the motions do not determine the place of the sensor: turn more, and drive between turns")
    eliminated, *_ = np.linalg.lstsq(others, turned, rcond=None)
    _, vectors = np.linalg.eigh((rest := turned - others @ eliminated).T @ rest)
    direction = vectors[:, 0]
    x, y, scale = -eliminated @ direction
    return np.array([x, y, *direction, scale])


def _of_known_scale(rows: Floats) -> Floats:
    """Minimise ``|rows q|`` with cos^2 + sin^2 = 1 and scale 1: a linear term on the circle, found by Newton steps."""
    places, turned, way = rows[:, :2], rows[:, 2:4], rows[:, 4]
    eliminated, *_ = np.linalg.lstsq(places, np.column_stack([turned, way]), rcond=None)
    rest = np.column_stack([turned, way]) - places @ eliminated
    M = rest.T @ rest
    H, g = M[:2, :2], M[:2, 2]
    if float(np.abs(M).max()) < 1e-18:
        raise DataError("the motions do not determine the yaw of the sensor: drive between turns")
    yaws = np.linspace(-math.pi, math.pi, 73)
    units = np.stack([np.cos(yaws), np.sin(yaws)])
    yaw = float(yaws[np.argmin(np.einsum("in,ij,jn->n", units, H, units) + 2.0 * g @ units)])
    for _ in range(20):
        unit, across = np.array([math.cos(yaw), math.sin(yaw)]), np.array([-math.sin(yaw), math.cos(yaw)])
        slope = float(across @ (H @ unit + g))
        curve = float(across @ H @ across - unit @ (H @ unit + g))
        if curve <= 0.0 or abs(slope) < 1e-15 * curve:
            break
        yaw -= slope / curve
    unit = np.array([math.cos(yaw), math.sin(yaw)])
    x, y = -eliminated @ np.array([*unit, 1.0])
    return np.array([x, y, *unit, 1.0])
