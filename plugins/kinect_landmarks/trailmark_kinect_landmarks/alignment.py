"""Pose from landmarks: closed form of two, weighted robust rigid alignment of more, in the plane or in space.

Everywhere ``points_a = R_a_b points_b + t_a_b``, points one per row, D = 2 or 3 columns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Bools, Floats
from trailmark.errors import ShapeError
from trailmark.geometry import Pose2
from trailmark.geometry.rigid import kabsch
from trailmark_kinect_landmarks.expectation import Expected
from trailmark_kinect_landmarks.kernels import normal_equations, whitened_misses, widest_pair

__all__ = [
    "GATES",
    "AlignmentLimits",
    "CloudAlignment",
    "Refusal",
    "align",
    "jacobian",
    "planar_covariance",
    "pose_from_two",
    "reachable",
    "refusal_of",
]


#: Squared sigmas in two and three numbers: chi-square, 99.9 %.
GATES = {2: 13.8, 3: 16.3}
_N_GAUSS_NEWTON = 6
_SOFT = 9.0  # squared sigmas at which a residual counts a quarter
_TRUSTED_SHARE = 0.4  # of the landmarks that agree with where the prediction leads, so that nothing else is tried
_LEAST_NOISE = 0.25  # of the variance that is assumed: a quiet camera says so by its residuals, a few of them by chance
_N_FINALISTS = 5  # sets that are judged with the full covariances
_MAX_EXHAUSTIVE = 120  # minimal sets tried all, rather than drawn


@dataclass(frozen=True, slots=True)
class AlignmentLimits:
    """What is too little to answer.

    Attributes
    ----------
    min_landmarks : int
        Landmarks that must agree; at least 2 in the plane and 3 in space.
    min_separation_m : float
        The two farthest must be at least this far apart [m].
    min_angle_rad : float
        ... and not in line with the camera: their directions differ by this much [rad].
    """

    min_landmarks: int = 2
    min_separation_m: float = 0.3
    min_angle_rad: float = math.radians(2.0)


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why there is no pose, in a few words.

    Attributes
    ----------
    reason : str
        For `Lost`.
    """

    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class CloudAlignment:
    """A rigid motion.

    Attributes
    ----------
    R, t : (D, D), (D,) float64
        ``points_a = R points_b + t``.
    covariance : (3, 3) or (6, 6) float64
        Of the translation and a small rotation on the left, ``R = exp(d) R_true``: (x, y, theta), or
        (x, y, z, turns about x, y, z).
    inliers : (N,) bool
        Which points agree.
    residual_m : float
        Root mean square distance of those that agree [m].
    """

    R: Floats
    t: Floats
    covariance: Floats
    inliers: npt.NDArray[np.bool_]
    residual_m: float


class _Missed(NamedTuple):
    """By how much landmarks miss a motion, as `whitened_misses` returns it."""

    misses: Floats
    whitening: Floats
    squared: Floats


@dataclass(frozen=True, slots=True, eq=False)
class _Pairs:
    """Landmarks as remembered (a) and as seen (b), of `align`, contiguous."""

    points_a: Floats
    points_b: Floats
    cov_a: Floats
    cov_b: Floats

    def missed(self, R: Floats, t: Floats) -> _Missed:
        """Return by how much they miss a motion."""
        R, t = np.ascontiguousarray(R), np.ascontiguousarray(t)
        return _Missed(*whitened_misses(self.points_a, self.points_b, self.cov_a, self.cov_b, R, t))


def pose_from_two(A_start: Floats, B_start: Floats, A_now: Floats, B_now: Floats) -> Pose2:
    """Return ``pose_start_now`` from two landmarks in the plane, in closed form.

    The turn is that of the line AB; the middle of AB stays where it is. Points (2,), x forward and y left [m].

    Parameters
    ----------
    A_start, B_start : (2,) float64
        The landmarks as seen from the start [m].
    A_now, B_now : (2,) float64
        The same landmarks as seen now [m].

    Returns
    -------
    Pose2
        ``pose_start_now``.
    """
    line_start, line_now = B_start - A_start, B_now - A_now
    theta = math.atan2(line_start[1], line_start[0]) - math.atan2(line_now[1], line_now[0])
    turned = Pose2(0.0, 0.0, theta) @ ((A_now + B_now) / 2.0)
    middle = (A_start + B_start) / 2.0 - turned
    return Pose2(float(middle[0]), float(middle[1]), theta)


def refusal_of(points_b: Floats, limits: AlignmentLimits) -> Refusal | None:
    """Return why landmarks, as seen now, cannot carry a pose; None when they can."""
    n, D = points_b.shape
    needed = max(limits.min_landmarks, D)
    if n < needed:
        return Refusal(f"{n} landmarks agree, {needed} are needed")
    separation_m, cosine = widest_pair(np.ascontiguousarray(points_b))
    if separation_m < limits.min_separation_m:
        return Refusal(f"landmarks only {separation_m:.2f} m apart, less than {limits.min_separation_m:g} m")
    if math.acos(max(-1.0, cosine)) < limits.min_angle_rad:
        return Refusal("landmarks in line with the camera")
    if D == 3:
        spread = np.linalg.svd(points_b - points_b.mean(axis=0), compute_uv=False) / math.sqrt(n)
        if spread[1] < limits.min_separation_m / 6.0:  # the turn about their line stays open
            return Refusal("landmarks all on one line")
    return None


def align(
    points_a: Floats,
    points_b: Floats,
    cov_a: Floats,
    cov_b: Floats,
    *,
    rng: np.random.Generator,
    limits: AlignmentLimits | None = None,
    expected: Expected | None = None,
    n_tries: int = 96,
) -> CloudAlignment | Refusal:
    """Return the rigid motion that most landmarks agree on.

    Gauss-Newton with the covariances of both sides, the far depth of a landmark counting less than its direction, and
    a redescending loss: a landmark that begins to move must not pull. It starts at the expectation, where 0.4 of all
    landmarks agree with where that leads ("expected movement", as the paper proposes); otherwise at the consensus of
    minimal sets. Consensus alone may follow a thing that walks: far landmarks forgive a shift that a turn makes up for.

    Parameters
    ----------
    points_a, points_b : (N, D) float
        Remembered and seen, row by row the same landmark [m].
    cov_a, cov_b : (N, D, D) float
        Their covariances, in the axes of their points [m^2].
    rng : Generator
        Draws the minimal sets when there are too many to try all.
    expected : Expected, optional
        The motion that is expected. It chooses landmarks, and steadies what they leave open: far ones before a wall
        hardly tell a shift from a turn. The covariance is that of the landmarks alone.

    Raises
    ------
    ShapeError
        If the shapes do not fit.
    """
    limits = limits or AlignmentLimits()
    n, D = points_a.shape
    if points_b.shape != (n, D) or cov_a.shape != (n, D, D) or cov_b.shape != (n, D, D):
        raise ShapeError(f"{points_a.shape}, {points_b.shape}, {cov_a.shape} and {cov_b.shape} do not belong together")
    pairs = _Pairs(*(np.ascontiguousarray(array, np.float64) for array in (points_a, points_b, cov_a, cov_b)))
    refusal = refusal_of(points_b, limits)
    if refusal is not None:
        return refusal
    led = None if expected is None else _from_expected(pairs, expected)
    if led is None:
        R, t = _consensus(pairs, expected, rng, n_tries)
        able, slack = np.ones(n, dtype=np.bool_), 4.0
    else:
        R, t, able = led
        slack = 1.0
    missed = pairs.missed(R, t)
    inliers, asked = able & (missed.squared < slack * GATES[D]), np.ones(n, np.bool_)
    chi2, information = 0.0, np.eye(D)
    for _ in range(_N_GAUSS_NEWTON):
        if not np.array_equal(inliers, asked):
            refusal, asked = refusal_of(points_b[inliers], limits), inliers
            if refusal is not None:
                return refusal
        chi2 = float(missed.squared[inliers].sum())
        R, t, information = _step(pairs, missed, inliers, R, t, expected=None if led is None else expected)
        missed = pairs.missed(R, t)
        inliers = able & (missed.squared < GATES[D])
    refusal = refusal_of(points_b[inliers], limits)
    if refusal is not None:
        return refusal
    misses = points_a[inliers] - points_b[inliers] @ R.T - t
    dof = max(1, D * int(inliers.sum()) - len(information))
    covariance = np.linalg.inv(information) * max(_LEAST_NOISE, chi2 / dof)
    return CloudAlignment(R, t, covariance, inliers, math.sqrt(float((misses**2).sum(axis=1).mean())))


def reachable(
    points_a: Floats, points_b: Floats, cov_a: Floats, cov_b: Floats, expected: Expected
) -> npt.NDArray[np.bool_]:
    """Return which landmarks are where they may be, given how sure the expectation is.

    Parameters
    ----------
    points_a, points_b : (N, D) float64
        Remembered and seen positions, D 2 or 3 [m].
    cov_a, cov_b : (N, D, D) float64
        Their covariances [m^2].
    expected : Expected
        The expected motion with its covariance.

    Returns
    -------
    (N,) bool
        Landmarks within the gate.
    """
    R, t = expected.R, expected.t
    J = jacobian(points_b @ R.T)
    cov = cov_a + R @ cov_b @ R.T + J @ np.linalg.inv(expected.information) @ J.transpose(0, 2, 1)
    misses = points_a - points_b @ R.T - t
    squared = np.einsum("ni,nij,nj->n", misses, np.linalg.inv(cov), misses)
    return np.asarray(squared < GATES[points_a.shape[1]])


def _from_expected(pairs: _Pairs, expected: Expected) -> tuple[Floats, Floats, Bools] | None:
    """Return where the expectation leads, and which landmarks agree with it; None when too few do.

    What is farther off than landmark and expectation allow moves by itself and is left out at once. The loss is as wide
    as the median residual of the others asks for, and narrows as that falls: an expectation that is off is off for all
    of them alike.
    """
    able = reachable(pairs.points_a, pairs.points_b, pairs.cov_a, pairs.cov_b, expected)
    if able.mean() < _TRUSTED_SHARE:
        return None
    R, t = expected.R, expected.t
    for _ in range(_N_GAUSS_NEWTON):
        missed = pairs.missed(R, t)
        median = float(np.median(missed.squared[able]))
        if not math.isfinite(median):
            return None
        R, t, _ = _step(pairs, missed, able, R, t, max(_SOFT, 2.0 * median), expected)
    agreeing = able & (pairs.missed(R, t).squared < GATES[len(t)])
    return (R, t, agreeing) if agreeing.mean() >= _TRUSTED_SHARE else None


def _sets(n: int, size: int, rng: np.random.Generator, n_tries: int) -> npt.NDArray[np.intp]:
    if math.comb(n, size) <= _MAX_EXHAUSTIVE:
        return np.array(list(combinations(range(n), size)), dtype=np.intp)
    return np.argsort(rng.random((n_tries, n)), axis=1)[:, :size].astype(np.intp)


def _consensus(
    pairs: _Pairs, expected: Expected | None, rng: np.random.Generator, n_tries: int
) -> tuple[Floats, Floats]:
    """Return the motion of the minimal set, or the expected one, with the least truncated cost."""
    n, D = pairs.points_a.shape
    sets = _sets(n, D, rng, n_tries)
    Rs, ts = kabsch(pairs.points_a[sets], pairs.points_b[sets], np.ones(sets.shape))
    variance = (np.trace(pairs.cov_a, axis1=1, axis2=2) + np.trace(pairs.cov_b, axis1=1, axis2=2)) / D
    misses = pairs.points_a - np.einsum("hij,nj->hni", Rs, pairs.points_b) - ts[:, None, :]
    cost = np.minimum((misses**2).sum(axis=2) / variance, GATES[D]).sum(axis=1)
    candidates = [(Rs[i], ts[i]) for i in np.argsort(cost)[:_N_FINALISTS]]
    if expected is not None:
        candidates.append((expected.R, expected.t))
    exact = [np.minimum(pairs.missed(R, t).squared, GATES[D]).sum() for R, t in candidates]
    return candidates[int(np.argmin(exact))]


def _step(
    pairs: _Pairs,
    missed: _Missed,
    which: Bools,
    R: Floats,
    t: Floats,
    soft: float = _SOFT,
    expected: Expected | None = None,
) -> tuple[Floats, Floats, Floats]:
    """Return the motion after one Gauss-Newton step of some pairs, and their information before it."""
    # Geman & McClure: what hardly fits hardly counts
    weights = np.where(which, np.square(soft / (soft + missed.squared)), 0.0)
    H, g, information = normal_equations(pairs.points_b @ R.T, missed.misses, missed.whitening, weights)
    if expected is not None:
        H, g = H + expected.information, g + expected.information @ expected.seen_from(R, t)
    delta = np.asarray(np.linalg.solve(H, g), np.float64)
    return _exp(delta[len(t) :]) @ R, t + delta[: len(t)], information


def jacobian(turned: Floats) -> Floats:
    """Return d(R p + t) by translation and left rotation, (N, D, 3 or 6)."""
    n, D = turned.shape
    J = np.zeros((n, D, 3 if D == 2 else 6))
    J[:, :, :D] = np.eye(D)
    if D == 2:
        J[:, 0, 2], J[:, 1, 2] = -turned[:, 1], turned[:, 0]
        return J
    x, y, z = turned.T
    J[:, 0, 4], J[:, 0, 5] = z, -y
    J[:, 1, 3], J[:, 1, 5] = -z, x
    J[:, 2, 3], J[:, 2, 4] = y, -x
    return J


def _exp(turn: Floats) -> Floats:
    """Return the rotation matrix of a small turn: an angle (1,), or a rotation vector (3,) [rad]."""
    if len(turn) == 1:
        c, s = math.cos(turn[0]), math.sin(turn[0])
        return np.array([[c, -s], [s, c]])
    angle = float(np.linalg.norm(turn))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = turn / angle
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * (K @ K))


def planar_covariance(alignment: CloudAlignment) -> Floats:
    """Return the (3, 3) covariance of x, y and heading, the heading being that of the turned x axis."""
    if len(alignment.t) == 2:
        return alignment.covariance
    ahead = alignment.R[:, 0]
    flat = max(float(ahead[0] ** 2 + ahead[1] ** 2), 1e-6)
    J = np.zeros((3, 6))
    J[0, 0] = J[1, 1] = 1.0
    # d(heading) = (x dy - y dx) / (x^2 + y^2) with d(ahead) = turn x ahead
    J[2, 3:] = (-ahead[0] * ahead[2] / flat, -ahead[1] * ahead[2] / flat, 1.0)
    return np.asarray(J @ alignment.covariance @ J.T)
