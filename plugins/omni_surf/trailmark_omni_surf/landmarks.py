"""Where a landmark is, from bearings taken at known poses: Eq. (3) and the six features of Tasaki et al. 2010."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import ShapeError
from trailmark.geometry import wrap_angles

__all__ = ["FEATURE_NAMES", "LandmarkMeasurement", "landmark_features", "measure_landmark"]


#: The six features that the selection looks at, in the paper's order.
FEATURE_NAMES = (
    "n_observations",
    "error_rad2",
    "mean_image_distance_px",
    "variance_x_m2",
    "variance_y_m2",
    "variance_direction_rad2",
)

# A tracked point drifts along its edge, and pictures near to one another err alike: more sightings than these tell
# nothing more of where a landmark is.
_MOST_INDEPENDENT = 4
# A blob has a size and a depth: seen from elsewhere, another point is its middle, by so much [m].
_BLOB_M = 0.05
_MIN_SPREAD = 1e-6  # rays closer to parallel than a milliradian do not meet


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkMeasurement:
    """A measured landmark.

    Attributes
    ----------
    position : (2,) float64
        In the map [m].
    covariance : (2, 2) float64
        Of the position, for the bearing noise that the residuals show, as if of four sightings at most, and for the
        size of what is seen [m^2].
    errors_rad : (N,) float64
        Bearing residual of every observation [rad].
    is_inlier : (N,) bool
        Observations that agree.
    """

    position: Floats
    covariance: Floats
    errors_rad: Floats
    is_inlier: npt.NDArray[np.bool_]


def measure_landmark(
    poses: Floats,
    bearings: Floats,
    *,
    form: Literal["sine_cosine", "tangent"] = "sine_cosine",
    sigma_rad: float = math.radians(1.0),
    gate_rad: float = math.radians(5.0),
) -> LandmarkMeasurement | None:
    """Return the point that the rays of all observations meet in, or None when they do not.

    Parameters
    ----------
    poses : (N, 3) float64
        Pose of the robot at each observation, (x, y, theta) [m, m, rad].
    bearings : (N,) float64
        Bearing of the landmark in base axes [rad].
    form : {"sine_cosine", "tangent"}
        Each ray as ``sin(phi) x - cos(phi) y = sin(phi) X - cos(phi) Y``, or Eq. (3) as printed, which is that
        divided by ``cos(phi)`` and so blows up at +-90 degrees.
    sigma_rad, gate_rad : float
        Noise of a good bearing; a larger residual than the gate is a mismatch and left out [rad].

    Raises
    ------
    ShapeError
        If the arrays do not fit each other.
    """
    if poses.ndim != 2 or poses.shape[1] != 3 or bearings.shape != (len(poses),):
        raise ShapeError(f"poses {poses.shape} and bearings {bearings.shape} must be (N, 3) and (N,)")
    directions = poses[:, 2] + bearings
    is_inlier = np.ones(len(poses), dtype=bool)
    for _ in range(5):
        meeting = _intersection(poses[is_inlier], directions[is_inlier], form)
        if meeting is None:
            return None
        position = meeting
        errors = _residuals(position, poses, directions)
        scale = max(gate_rad, 2.5 * float(np.median(np.abs(errors[is_inlier]))))
        before, is_inlier = is_inlier, np.abs(errors) <= min(scale, 4.0 * gate_rad)
        if np.array_equal(before, is_inlier):
            break
    if is_inlier.sum() < 2 or np.abs(errors[is_inlier]).max() > gate_rad:
        return None
    covariance = _covariance(position, poses[is_inlier], errors[is_inlier], sigma_rad)
    return None if covariance is None else LandmarkMeasurement(position, covariance, errors, is_inlier)


def landmark_features(
    poses: Floats, bearings: Floats, image_distances_px: Floats, measurement: LandmarkMeasurement
) -> Floats:
    """Return the six features of a candidate, (6,), in the order of `FEATURE_NAMES`.

    Parameters
    ----------
    poses : (N, 3) float64
        Pose of the robot at each observation [m, m, rad].
    bearings : (N,) float64
        Bearing in base axes [rad].
    image_distances_px : (N,) float64
        Distance of the point from the image centre at each observation [px].
    measurement : LandmarkMeasurement
        What `measure_landmark` made of them.
    """
    directions = poses[:, 2] + bearings
    mean_direction = math.atan2(float(np.sin(directions).mean()), float(np.cos(directions).mean()))
    return np.array(
        [
            len(poses),
            float(np.mean(measurement.errors_rad**2)),
            float(np.mean(image_distances_px)),
            float(np.var(poses[:, 0])),
            float(np.var(poses[:, 1])),
            float(np.mean(wrap_angles(directions - mean_direction) ** 2)),
        ]
    )


def _intersection(poses: Floats, directions: Floats, form: str) -> Floats | None:
    """Return the least-squares intersection of the rays, Eq. (3); None when they are parallel."""
    if len(poses) < 2:
        return None
    if form == "tangent":
        rows = np.stack([np.tan(directions), -np.ones(len(directions))], axis=1)
    else:
        rows = np.stack([np.sin(directions), -np.cos(directions)], axis=1)
    unit = np.stack([np.sin(directions), -np.cos(directions)], axis=1)
    if np.linalg.eigvalsh(unit.T @ unit)[0] < _MIN_SPREAD * len(poses):
        return None
    right = (rows * poses[:, :2]).sum(axis=1)
    return np.asarray(np.linalg.pinv(rows) @ right)


def _residuals(position: Floats, poses: Floats, directions: Floats) -> Floats:
    to_landmark = position - poses[:, :2]
    return wrap_angles(directions - np.arctan2(to_landmark[:, 1], to_landmark[:, 0]))


def _covariance(position: Floats, poses: Floats, errors: Floats, sigma_rad: float) -> Floats | None:
    to_landmark = position - poses[:, :2]
    squared = np.maximum((to_landmark**2).sum(axis=1), 1e-4)
    jacobian = np.stack([-to_landmark[:, 1], to_landmark[:, 0]], axis=1) / squared[:, None]
    information = jacobian.T @ jacobian
    if np.linalg.cond(information) > 1e12:
        return None
    spare = max(len(poses) - 2, 1)
    variance = max(sigma_rad**2, float((errors**2).sum()) / spare)
    alike = max(1.0, len(poses) / _MOST_INDEPENDENT)
    return np.asarray(np.linalg.inv(information) * variance * alike + _BLOB_M**2 * np.eye(2))
