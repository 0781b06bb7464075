"""A local map of the last scans, and the pose at which a scan lies on it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from trailmark.arrays import Floats
from trailmark.geometry import Pose2
from trailmark_laser_maps.odometry.lines import scan_normals

__all__ = ["LocalMap", "LocalMatch"]

# The gate shrinks: the first steps pull in from afar, the last are not bent by what does not belong.
_GATES_M = (0.8, 0.8, 0.6, 0.5, 0.4, 0.3, 0.25, 0.2, 0.15, 0.15, 0.15)
_FIT_M = 0.15
#: Neighbouring points share an error: so many of them count as one.
_CORRELATION = 10.0
#: Normals are uncertain by some 6 degrees; what a plain wall seems to say along itself is that.
_NORMAL_NOISE = 0.01
_CLEARLY = 0.02
#: What no match is better than [m, rad].
_FLOOR = np.diag(np.square((0.003, 0.003, math.radians(0.08))))


@dataclass(frozen=True, slots=True, eq=False)
class LocalMatch:
    """How a scan lies on the scans before it.

    Attributes
    ----------
    pose : Pose2
        Of base in the frame of the local map.
    information : (3, 3) float64
        Of (x, y, theta) of `pose` in that frame; none along a plain corridor.
    share : float
        Of points within 0.15 m of the map.
    residual_m : float
        Root mean square distance of those to their lines [m].
    """

    pose: Pose2
    information: Floats
    share: float
    residual_m: float

    @property
    def cost(self) -> float:
        """What is minimal for the best of several matches."""
        return self.residual_m - self.share


class LocalMap:
    """The last scans, each at the pose at which it was matched.

    Parameters
    ----------
    keep_scans : int
        How many.
    """

    def __init__(self, keep_scans: int) -> None:
        self._scans: deque[tuple[Floats, Floats]] = deque(maxlen=keep_scans)

    def __len__(self) -> int:
        return len(self._scans)

    def add(self, pose: Pose2, points_base: Floats) -> None:
        """Add a scan, its points (N, 2) in the order of the rays [m]."""
        points = pose @ points_base
        self._scans.append((points, scan_normals(points)))
        self._points = np.concatenate([scan for scan, _ in self._scans])
        self._normals = np.concatenate([normals for _, normals in self._scans])
        self._tree = cKDTree(self._points)

    def match(self, points_base: Floats, guesses: Sequence[Pose2], sigma_m: float) -> LocalMatch:
        """Return the best match of points (N, 2) from several guesses; the first, unless another is clearly better."""
        first, *others = [self._match(points_base, guess, sigma_m) for guess in guesses]
        best = min(others, key=lambda one: one.cost, default=first)
        return best if best.cost < first.cost - _CLEARLY else first

    def _match(self, points_base: Floats, guess: Pose2, sigma_m: float) -> LocalMatch:
        """Iterate closest lines (Chen & Medioni 1992) with Huber weights."""
        pose = guess
        for gate_m in _GATES_M:
            hessian, gradient, _, n_lines = self._equations(pose, points_base, gate_m)
            if n_lines < 6:
                return LocalMatch(pose, np.zeros((3, 3)), 0.0, math.inf)
            step = _told_step(hessian, gradient, n_lines)
            pose = Pose2(pose.x - step[0], pose.y - step[1], pose.theta - step[2])
            if np.abs(step).max() < 2e-5 and gate_m <= _FIT_M:
                break
        hessian, _, squared, n_lines = self._equations(pose, points_base, _FIT_M)
        distances, _ = self._tree.query(pose @ points_base)
        residual_m = math.sqrt(squared / max(n_lines, 1))
        information = _told_by_lines(hessian, n_lines) / (_CORRELATION * max(sigma_m, residual_m) ** 2)
        limited = information @ np.linalg.inv(np.eye(3) + _FLOOR @ information)
        return LocalMatch(pose, (limited + limited.T) / 2.0, float(np.mean(distances < _FIT_M)), residual_m)

    def _equations(self, pose: Pose2, points_base: Floats, gate_m: float) -> tuple[Floats, Floats, float, int]:
        """Return Gauss-Newton's matrix and gradient, the sum of squared residuals, and how many lines say something."""
        points = pose @ points_base
        distances, nearest = self._tree.query(points, distance_upper_bound=gate_m)
        nearest = np.where(np.isfinite(distances), nearest, 0)
        normals = self._normals[nearest]
        is_used = np.isfinite(distances) & (np.abs(normals).sum(axis=1) > 0.0)
        normals, arms = normals[is_used], points[is_used] - (pose.x, pose.y)
        residuals = ((points[is_used] - self._points[nearest[is_used]]) * normals).sum(axis=1)
        rows = np.column_stack([normals, normals[:, 1] * arms[:, 0] - normals[:, 0] * arms[:, 1]])
        corner = gate_m / 3.0
        weights = np.minimum(1.0, corner / np.maximum(np.abs(residuals), 1e-12))
        weighted = rows * weights[:, np.newaxis]
        return weighted.T @ rows, weighted.T @ residuals, float(residuals @ residuals), len(residuals)


def _told_step(hessian: Floats, gradient: Floats, n_lines: int) -> Floats:
    """Return Gauss-Newton's step in the directions that walls tell; a corridor leaves one free, and it is held."""
    values, vectors = np.linalg.eigh(hessian)
    is_told = values > _NORMAL_NOISE * n_lines
    shares = np.where(is_told, (vectors.T @ gradient) / np.where(is_told, values, 1.0), 0.0)
    return np.asarray(vectors @ shares)


def _told_by_lines(hessian: Floats, n_lines: int) -> Floats:
    """Return the normal matrix without what noise of the normals puts into a direction that no wall tells."""
    values, vectors = np.linalg.eigh(hessian - np.diag([1.0, 1.0, 0.0]) * _NORMAL_NOISE * n_lines)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)
