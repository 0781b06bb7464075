"""A local map of the last scans, and the pose at which a scan lies on it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from trailmark.arrays import Floats
from trailmark.geometry import Pose2
from trailmark.geometry.scans.lines import scan_normals
from trailmark.geometry.scans.things import few_small_things
from trailmark.geometry.scans.uncertainty import match_information
from trailmark.geometry.walls import limited_information, line_equations, measured_step

__all__ = ["LocalMap", "LocalMatch"]

# The gate shrinks: the first steps pull in from afar, the last are not bent by what does not belong.
_GATES_M = (0.8, 0.8, 0.6, 0.5, 0.4, 0.3, 0.25, 0.2, 0.15, 0.15, 0.15)
_FIT_M = 0.15
#: Gauss-Newton's steps without the few small things, and the square of how many sigmas they lead away where these have
#: drawn the match; by less, walls that are seen askew differ from them too.
_STEPS_WITHOUT, _DRAWN = 3, 25.0
#: Without the few small things, a match is looked for aside too, with these gates; it is elsewhere beyond so many
#: sigmas squared, and fits as well if the sum of squares is not larger by as much.
_ASIDE_M, _GATES_ELSEWHERE_M, _ELSEWHERE = 0.1, (0.3, 0.2, 0.15, 0.15, 0.15), 9.0
_CLEARLY = 0.02
#: A direction is told whose information is more than this share of the largest.
_TOLD = 1e-9
#: What no match is better than [m, rad].
_FLOOR = (0.001, math.radians(0.03))


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
        """Return the best match of points (N, 2) from several guesses; the first, unless another is clearly better.

        In directions that no wall tells, another match is held at the first guess: along a corridor it is as near to
        the same points of the walls wherever it stands, and nearest where it stood before.
        """
        first, *others = [self._match(points_base, guess, sigma_m) for guess in guesses]
        best = min(others, key=lambda one: one.cost, default=first)
        match = _held(best, guesses[0]) if best.cost < first.cost - _CLEARLY else first
        return self._without_few(match, points_base, guesses, sigma_m)

    def _match(self, points_base: Floats, guess: Pose2, sigma_m: float) -> LocalMatch:
        """Iterate closest lines (Chen & Medioni 1992) with Huber weights."""
        pose = guess
        for gate_m in _GATES_M:
            hessian, gradient, residuals, _ = self._equations(pose, points_base, gate_m)
            n_lines = int(np.isfinite(residuals).sum())
            if n_lines < 6:
                return LocalMatch(pose, np.zeros((3, 3)), 0.0, math.inf)
            step = measured_step(hessian, gradient, n_lines)
            pose = Pose2(pose.x - step[0], pose.y - step[1], pose.theta - step[2])
            if np.abs(step).max() < 2e-5 and gate_m <= _FIT_M:
                break
        hessian, _, residuals, _ = self._equations(pose, points_base, _FIT_M)
        distances, _ = self._tree.query(pose @ points_base)
        n_lines = int(np.isfinite(residuals).sum())
        residual_m = math.sqrt(float(np.nansum(np.square(residuals))) / max(n_lines, 1))
        limited = limited_information(match_information(hessian, residuals, sigma_m), _FLOOR)
        return LocalMatch(pose, limited, float(np.mean(distances < _FIT_M)), residual_m)

    def _without_few(
        self, match: LocalMatch, points_base: Floats, guesses: Sequence[Pose2], sigma_m: float
    ) -> LocalMatch:
        """Return a match that tells only what is not told by a few small things alone, and not where they drew it."""
        _, _, all_residuals, normals = self._equations(match.pose, points_base, _FIT_M)
        is_few = few_small_things(match.pose @ points_base, normals, np.array((match.pose.x, match.pose.y)))
        if not is_few.any():
            return match
        rest = points_base[~is_few]
        pose = self._stepped(rest, match.pose, (_FIT_M,) * _STEPS_WITHOUT)
        hessian, _, residuals, _ = self._equations(pose, rest, _FIT_M)
        information = limited_information(match_information(hessian, residuals, sigma_m), _FLOOR)
        drawn = _away(pose, match.pose)
        if float(drawn @ information @ drawn) > _DRAWN:
            told = replace(match, pose=pose, information=information)
        else:  # what is left out had its part in the pose, and makes it as uncertain as it fits badly
            limited = limited_information(match_information(hessian, all_residuals, sigma_m), _FLOOR)
            told = replace(match, information=limited)
        return self._covering(told, rest, guesses, sigma_m)

    def _covering(self, match: LocalMatch, rest: Floats, guesses: Sequence[Pose2], sigma_m: float) -> LocalMatch:
        """Return a match so uncertain that it covers where else the rest lies as well: small things are near others."""
        values, vectors = np.linalg.eigh(match.information[:2, :2])
        if values[0] <= _TOLD * max(float(values[1]), 1e-12):
            return match
        aside = np.append(_ASIDE_M * vectors[:, 0], 0.0)
        starts = [*guesses[:2], *(Pose2.from_array(match.pose.array() + side) for side in (aside, -aside))]
        spread, misfit = np.zeros((3, 3)), self._misfit(rest, match.pose, sigma_m)
        for start in starts:
            far = _away(start, match.pose)
            if float(far @ match.information @ far) < _ELSEWHERE:
                continue
            other = self._stepped(rest, start, _GATES_ELSEWHERE_M)
            away = _away(other, match.pose)
            is_elsewhere = float(away @ match.information @ away) > _ELSEWHERE
            if is_elsewhere and self._misfit(rest, other, sigma_m) < misfit + _ELSEWHERE:
                spread += np.outer(away, away)
        if not spread.any():
            return match
        told = match.information @ np.linalg.inv(np.eye(3) + spread @ match.information)
        return replace(match, information=np.asarray((told + told.T) / 2.0))

    def _stepped(self, points_base: Floats, pose: Pose2, gates_m: Sequence[float]) -> Pose2:
        """Return a pose after a step of Gauss-Newton with each of some gates."""
        for gate_m in gates_m:
            hessian, gradient, residuals, _ = self._equations(pose, points_base, gate_m)
            step = measured_step(hessian, gradient, int(np.isfinite(residuals).sum()))
            pose = Pose2(pose.x - step[0], pose.y - step[1], pose.theta - step[2])
        return pose

    def _misfit(self, points_base: Floats, pose: Pose2, sigma_m: float) -> float:
        """Return the sum of the squares of residuals in units of their sigmas, points without a line at the gate."""
        _, _, residuals, _ = self._equations(pose, points_base, _FIT_M)
        return float(np.square(np.nan_to_num(residuals, nan=_FIT_M) / sigma_m).sum())

    def _equations(self, pose: Pose2, points_base: Floats, gate_m: float) -> tuple[Floats, Floats, Floats, Floats]:
        """Return Gauss-Newton's matrix and gradient, how far points are beyond their walls, NaN: none, and normals."""
        points = pose @ points_base
        distances, nearest = self._tree.query(points, distance_upper_bound=gate_m)
        nearest = np.where(np.isfinite(distances), nearest, 0)
        normals = self._normals[nearest]
        is_used = np.isfinite(distances) & (np.abs(normals).sum(axis=1) > 0.0)
        normals, arms = normals[is_used], points[is_used] - (pose.x, pose.y)
        offsets = points[is_used] - self._points[nearest[is_used]]
        hessian, gradient = np.empty((3, 3)), np.empty(3)
        line_equations(arms, offsets, normals, gate_m / 3.0, hessian, gradient)
        residuals = np.full(len(points), math.nan)
        away = np.sign((arms * normals).sum(axis=1))  # normals are sign free
        residuals[is_used] = away * (offsets * normals).sum(axis=1)
        lines = np.zeros_like(points)
        lines[is_used] = normals
        return hessian, gradient, residuals, lines


def _held(match: LocalMatch, guess: Pose2) -> LocalMatch:
    """Return a match that differs from a guess only in directions of which it tells something."""
    values, vectors = np.linalg.eigh(match.information)
    told = vectors[:, values > _TOLD * max(float(values[-1]), 1e-12)]
    return replace(match, pose=Pose2.from_array(guess.array() + told @ (told.T @ _away(match.pose, guess))))


def _away(pose: Pose2, other: Pose2) -> Floats:
    """Return by how much a pose differs from another, in axes of both."""
    away = pose.array() - other.array()
    away[2] = math.remainder(away[2], 2.0 * math.pi)
    return away
