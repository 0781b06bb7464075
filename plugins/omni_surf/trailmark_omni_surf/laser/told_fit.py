"""The fit of a scan to others that goes no farther from a guess than walls tell."""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Pose2
from trailmark.geometry.walls import limited_information, measured_directions, measured_information, measured_step
from trailmark_omni_surf.laser.kernels import normal_equations, score_starts
from trailmark_omni_surf.laser.matching import FINE_GATES_M, FIT_GATE_M, ScanMatch
from trailmark_omni_surf.laser.scan_map import ScanMap

__all__ = ["told_fit"]

_GATES_M = (0.5, *FINE_GATES_M.tolist())
_ITERATIONS = 8
#: What no match is better than: position [m] and heading [rad].
_SIGMA = (0.003, math.radians(0.08))
_NOISE_M, _CORRELATION = 0.015, 10.0


def told_fit(scan_map: ScanMap, points: Floats, pose: Pose2, guess: Pose2) -> ScanMatch:
    """Return the fit at a pose, held at a guess in directions that no wall measures."""
    return _refined_held(scan_map, points, _told_part(scan_map, points, pose, guess))


def _told_part(scan_map: ScanMap, points: Floats, pose: Pose2, guess: Pose2) -> Pose2:
    """Return the pose that differs from a guess as another does, in directions that walls measure."""
    hessian, _, _, n_fit = _equations(scan_map, points, pose.array(), FIT_GATE_M)
    _, vectors, is_told = measured_directions(hessian, n_fit)
    away = pose.array() - guess.array()
    away[2] = math.remainder(away[2], 2.0 * math.pi)
    told = vectors[:, is_told]
    return Pose2.from_array(guess.array() + told @ (told.T @ away))


def _refined_held(scan_map: ScanMap, points: Floats, start: Pose2) -> ScanMatch:
    pose = start.array()
    for gate_m in _GATES_M:
        for _ in range(_ITERATIONS):
            hessian, gradient, _, n_fit = _equations(scan_map, points, pose, gate_m)
            if n_fit < 6:
                return ScanMatch(start, np.zeros((3, 3)), 0.0, math.inf, scan_map.reach_m, math.inf)
            step = measured_step(hessian, gradient, n_fit)
            pose = pose - step
            if np.abs(step).max() < 1e-4:
                break
    hessian, _, squared, n_fit = _equations(scan_map, points, pose, FIT_GATE_M)
    residual_m = math.sqrt(squared / max(n_fit, 1))
    information = measured_information(hessian, n_fit) / (_CORRELATION * max(_NOISE_M, residual_m) ** 2)
    raster = (scan_map.origin, scan_map.cell_m, scan_map.distance_m, scan_map.reach_m)
    cost_m = float(score_starts(points, pose[np.newaxis], *raster)[0])
    limited = limited_information(information, _SIGMA)
    return ScanMatch(Pose2.from_array(pose), limited, n_fit / len(points), residual_m, cost_m, math.inf)


def _equations(scan_map: ScanMap, points: Floats, pose: Floats, gate_m: float) -> tuple[Floats, Floats, float, int]:
    hessian, gradient = np.empty((3, 3)), np.empty(3)
    squared, n_fit = normal_equations(
        points, pose, scan_map.points, scan_map.normals, scan_map.origin, scan_map.cell_m, scan_map.nearest_idx,
        gate_m, True, hessian, gradient,
    )  # fmt: skip
    return hessian, gradient, squared, n_fit
