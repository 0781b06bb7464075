"""Where the robot is, from bearings to known landmarks (Tasaki et al. 2010, Sec. III-A)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import ShapeError
from trailmark.geometry import Pose2, wrap_angles
from trailmark_omni_surf.bearing_kernels import (
    bearing_errors,
    bearing_jacobian,
    bearing_scales,
    cost_and_step,
    hypotheses,
    refine,
    support,
)

__all__ = ["BearingFix", "BearingNoise", "locate", "position_sigma", "widened"]


_MAX_TRIPLES = 300
_ELSEWHERE_M, _ELSEWHERE_RAD = 0.5, math.radians(10.0)
_ITERATIONS = 20
# The share of a landmark's error that a fit leaves is taken as so much at least: of one that decides alone it is 0.
_LEAST_LEFT = 0.05


@dataclass(frozen=True, slots=True)
class BearingNoise:
    """What is known of the bearings, and what is asked of an answer.

    Attributes
    ----------
    sigma_rad : float
        Standard deviation of a good bearing [rad].
    gate_rad : float
        A landmark with a larger error is not the one it was taken for: T_p of the paper [rad].
    max_position_sigma_m : float
        An answer less certain than this is none: landmarks in line, or on a circle with the robot. Of three
        bearings, which agree whatever is wrong with them, half of it is asked [m].
    """

    sigma_rad: float = math.radians(1.0)
    gate_rad: float = math.radians(5.0)
    max_position_sigma_m: float = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class BearingFix:
    """A pose from bearings.

    Attributes
    ----------
    pose_map_base : Pose2
        The pose.
    information : (3, 3) float64
        Of (x, y, theta), in map axes.
    errors_rad : (N,) float64
        Bearing error of every landmark: the tracking-error criterion E of Eq. (4), with its sign [rad].
    is_inlier : (N,) bool
        Landmarks within the gate.
    support : float
        How many landmarks agree, each the less the larger its error.
    rival_support : float
        The same of the best pose elsewhere (0.5 m or 10 deg away); 0 where a start was given and none was looked for.
    """

    pose_map_base: Pose2
    information: Floats
    errors_rad: Floats
    is_inlier: npt.NDArray[np.bool_]
    support: float = 0.0
    rival_support: float = 0.0

    def widest_gap_rad(self, bearings: Floats) -> float:
        """Return the widest angle between neighbours among the landmarks that agree, seen from the robot [rad]."""
        seen = np.sort(bearings[self.is_inlier])
        return float(np.diff(seen, append=seen[0] + 2.0 * math.pi).max())


def locate(
    landmarks: Floats,
    bearings: Floats,
    noise: BearingNoise | None = None,
    start: Pose2 | None = None,
    covariances: Floats | None = None,
) -> BearingFix | None:
    """Return the pose that sees the landmarks under the bearings; None when they do not determine it.

    Without a start pose every triple of landmarks (an even choice when there are many) gives a pose in closed form,
    and the one with the best support is refined over the landmarks that agree with it. With a start pose, that is
    refined.

    Parameters
    ----------
    landmarks : (N, 2) float64
        Positions in the map, N >= 3 [m].
    bearings : (N,) float64
        Bearing of each in base axes, counter-clockwise from forward [rad].
    noise : BearingNoise, optional
        Noise and gates.
    start : Pose2, optional
        Where the robot is, roughly.
    covariances : (N, 2, 2) float64, optional
        Of the landmarks: a badly measured one counts less, most where its error lies across the line of sight [m^2].

    Raises
    ------
    ShapeError
        If the arrays do not fit each other.
    """
    if landmarks.ndim != 2 or landmarks.shape[1] != 2 or bearings.shape != (len(landmarks),):
        raise ShapeError(f"landmarks {landmarks.shape} and bearings {bearings.shape} must be (N, 2) and (N,)")
    if len(landmarks) < 3 or not (np.isfinite(landmarks).all() and np.isfinite(bearings).all()):
        return None
    noise = noise or BearingNoise()
    landmarks = np.ascontiguousarray(landmarks, dtype=np.float64)
    bearings = np.ascontiguousarray(bearings, dtype=np.float64)
    covariances = np.zeros((len(landmarks), 2, 2)) if covariances is None else np.ascontiguousarray(covariances)
    if covariances.shape != (len(landmarks), 2, 2):
        raise ShapeError(f"covariances of {len(landmarks)} landmarks must be (N, 2, 2), not {covariances.shape}")
    if start is not None:
        return _refine_fix(landmarks, bearings, covariances, start.array(), noise)
    every = max(1, math.ceil(math.comb(len(bearings), 3) / _MAX_TRIPLES))
    poses, supports = hypotheses(landmarks, bearings, noise.gate_rad, every)
    best = int(supports.argmax())
    if not np.isfinite(poses[best]).all():
        return None
    fix = _refine_fix(landmarks, bearings, covariances, poses[best], noise)
    return None if fix is None else replace(fix, rival_support=_rival_support(fix.pose_map_base, poses, supports))


def _rival_support(pose: Pose2, poses: Floats, supports: Floats) -> float:
    """Return the best support of a hypothesis that is elsewhere."""
    is_far = np.hypot(poses[:, 0] - pose.x, poses[:, 1] - pose.y) > _ELSEWHERE_M
    is_turned = np.abs(wrap_angles(poses[:, 2] - pose.theta)) > _ELSEWHERE_RAD
    return float(np.max(supports, where=is_far | is_turned, initial=0.0))


def _refine_fix(
    landmarks: Floats, bearings: Floats, covariances: Floats, pose: Floats, noise: BearingNoise
) -> BearingFix | None:
    """Refine over the landmarks within the gate, gate again, and refuse what is not determined."""
    is_inlier = np.abs(bearing_errors(landmarks, bearings, pose)) <= noise.gate_rad
    for _ in range(3):
        if is_inlier.sum() < 3:
            return None
        seen, scales = landmarks[is_inlier], bearing_scales(landmarks, covariances, pose, noise.sigma_rad)[is_inlier]
        pose = refine(seen, bearings[is_inlier], scales, pose, 2.0 * noise.sigma_rad, _ITERATIONS)
        errors = bearing_errors(landmarks, bearings, pose)
        before, is_inlier = is_inlier, np.abs(errors) <= noise.gate_rad
        if np.array_equal(before, is_inlier):
            break
    if is_inlier.sum() < 3:
        return None
    scales = bearing_scales(landmarks, covariances, pose, noise.sigma_rad)
    information = _information(landmarks[is_inlier], bearings[is_inlier], scales[is_inlier], pose, noise.sigma_rad)
    limit_m = noise.max_position_sigma_m / (2.0 if is_inlier.sum() == 3 else 1.0)  # three bearings hide every error
    if information is None or position_sigma(information) > limit_m:
        return None
    agreeing = support(landmarks, bearings, pose, noise.gate_rad)
    return BearingFix(Pose2.from_array(pose), information, errors, is_inlier, agreeing)


def _information(landmarks: Floats, bearings: Floats, scales: Floats, pose: Floats, sigma_rad: float) -> Floats | None:
    """Return the information of the pose, with the noise as large as the residuals say it is, if larger.

    It is less where the errors one by one say so, see `_less_where_one_decides`.
    """
    hessian, gradient = np.empty((3, 3)), np.empty(3)
    squared = cost_and_step(landmarks, bearings, scales, pose, math.inf, hessian, gradient)
    spare = len(bearings) - 3
    variance = max(sigma_rad**2, squared / spare) if spare > 0 else sigma_rad**2
    if np.linalg.cond(hessian) > 1e10:
        return None
    return _less_where_one_decides(hessian / variance, landmarks, bearings, scales, pose)


def _less_where_one_decides(
    information: Floats, landmarks: Floats, bearings: Floats, scales: Floats, pose: Floats
) -> Floats:
    """Return information that promises no more than the errors of the landmarks bear out one by one.

    A far landmark among near ones, or one on a side of its own, draws the pose to itself, and little error is left that
    tells. The covariance is at least the sum over the landmarks of what the error of each changes in the pose, divided
    by a power of the share of it that the fit leaves: half the landmark's leverage over the mean leverage, at most 2
    (HC4; F. Cribari-Neto, Computational Statistics & Data Analysis 45, 2004). Differs from that: it is 1/2 at least,
    which is right in the mean where all decide alike (HC2; S. D. Horn, R. A. Horn, D. B. Duncan, JASA 70, 1975). Of a
    landmark that agrees by chance it says nothing.
    """
    jacobian = bearing_jacobian(landmarks, pose) * scales[:, np.newaxis]
    errors = bearing_errors(landmarks, bearings, pose) * scales
    gains = jacobian @ np.linalg.inv(jacobian.T @ jacobian)
    leverages = (gains * jacobian).sum(axis=1)
    powers = np.clip(len(errors) * leverages / 3.0, 1.0, 4.0) / 2.0
    changes = gains * (errors / np.maximum(1.0 - leverages, _LEAST_LEFT) ** powers)[:, np.newaxis]
    return widened(information, changes.T @ changes)


def widened(information: Floats, covariance: Floats) -> Floats:
    """Return information that promises no more than a covariance in any direction.

    Parameters
    ----------
    information : (D, D) float64
        Positive definite.
    covariance : (D, D) float64
        Of the same numbers; positive semidefinite.
    """
    root = np.linalg.cholesky(information)
    times, axes = np.linalg.eigh(root.T @ covariance @ root)  # how many times the stated variance
    turned = root @ axes
    return np.asarray((turned / np.maximum(times, 1.0)) @ turned.T)


def position_sigma(information: Floats) -> float:
    """Return the standard deviation of the position along its worst direction [m]."""
    covariance = np.linalg.inv(information)
    return math.sqrt(max(0.0, float(np.linalg.eigvalsh(covariance[:2, :2])[-1])))
