"""Where the robot is, from bearings to known landmarks (Tasaki et al. 2010, Sec. III-A)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark.errors import ShapeError
from trailmark.geometry import Pose2
from trailmark_omni_surf.bearing_kernels import bearing_errors, consensus, cost_and_step, refine

__all__ = ["BearingFix", "BearingNoise", "locate"]

Array = npt.NDArray[np.float64]

_MAX_TRIPLES = 200
_ITERATIONS = 20


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
    """

    pose_map_base: Pose2
    information: Array
    errors_rad: Array
    is_inlier: npt.NDArray[np.bool_]


def locate(
    landmarks: Array, bearings: Array, noise: BearingNoise | None = None, start: Pose2 | None = None
) -> BearingFix | None:
    """Return the pose that sees the landmarks under the bearings, or None when they do not tell.

    Without a start pose every triple of landmarks (an even choice when there are many) gives a pose in closed form,
    and the one that most landmarks agree with is refined over those. With a start pose, that is refined.

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
    pose = start.array() if start is not None else _consensus(landmarks, bearings, noise.gate_rad)
    if pose is None:
        return None
    return _refined(landmarks, bearings, pose, noise)


def _consensus(landmarks: Array, bearings: Array, gate_rad: float) -> Array | None:
    """Return the closed-form pose that most landmarks agree with."""
    every = max(1, math.ceil(math.comb(len(bearings), 3) / _MAX_TRIPLES))
    pose = consensus(landmarks, bearings, gate_rad, every)
    return pose if np.isfinite(pose).all() else None


def _refined(landmarks: Array, bearings: Array, pose: Array, noise: BearingNoise) -> BearingFix | None:
    """Refine over the landmarks within the gate, gate again, and refuse what is not determined."""
    is_inlier = np.abs(bearing_errors(landmarks, bearings, pose)) <= noise.gate_rad
    for _ in range(3):
        if is_inlier.sum() < 3:
            return None
        pose = refine(landmarks[is_inlier], bearings[is_inlier], pose, 2.0 * noise.sigma_rad, _ITERATIONS)
        errors = bearing_errors(landmarks, bearings, pose)
        before, is_inlier = is_inlier, np.abs(errors) <= noise.gate_rad
        if np.array_equal(before, is_inlier):
            break
    if is_inlier.sum() < 3:
        return None
    information = _information(landmarks[is_inlier], bearings[is_inlier], pose, noise.sigma_rad)
    limit_m = noise.max_position_sigma_m / (2.0 if is_inlier.sum() == 3 else 1.0)  # three bearings hide every error
    if information is None or _position_sigma(information) > limit_m:
        return None
    return BearingFix(Pose2.from_array(pose), information, errors, is_inlier)


def _information(landmarks: Array, bearings: Array, pose: Array, sigma_rad: float) -> Array | None:
    """Return the information of the pose, with the noise as large as the residuals say it is, if larger."""
    hessian, gradient = np.empty((3, 3)), np.empty(3)
    squared = cost_and_step(landmarks, bearings, pose, math.inf, hessian, gradient)
    spare = len(bearings) - 3
    variance = max(sigma_rad**2, squared / spare) if spare > 0 else sigma_rad**2
    if np.linalg.cond(hessian) > 1e10:
        return None
    return np.asarray(hessian / variance)


def _position_sigma(information: Array) -> float:
    """Return the standard deviation of the position along its worst direction [m]."""
    covariance = np.linalg.inv(information)
    return math.sqrt(max(0.0, float(np.linalg.eigvalsh(covariance[:2, :2])[-1])))
