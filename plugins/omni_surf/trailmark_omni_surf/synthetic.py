"""Labelled landmark candidates from geometry alone: drives, bearings with noise, mismatches. No pictures."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.geometry import wrap_angles
from trailmark_omni_surf.landmarks import landmark_features, measure_landmark

__all__ = ["synthetic_candidates"]


_FOCAL_PX = 60.0  # of the stand-in mirror: image distance = focal * (pi / 2 + elevation)


def synthetic_candidates(
    n: int, rng: np.random.Generator, label_distance_m: float = 0.6
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Return features and labels of `n` candidates.

    Each candidate is one landmark, 0.3 to 2 m above or below the camera, seen from a drive in a hall of 5 to 15 m: a
    straight line, an arc or two legs, of which a stretch of 0.2 to 6 m sees it. Bearings carry noise of 0.3 to
    2 degrees and poses of 1 to 5 cm; in four of ten, a part of the observations is of another landmark, as when
    similar things are taken for one.

    Parameters
    ----------
    n : int
        How many.
    rng : numpy.random.Generator
        Makes them.
    label_distance_m : float
        T_d: a landmark is good when measured closer than this to where it is [m].

    Returns
    -------
    features : (n, 6) float64
        In the order of `FEATURE_NAMES`.
    is_good : (n,) bool
        |measured - true| < T_d.
    """
    rows: list[Floats] = []
    labels: list[bool] = []
    while len(rows) < n:
        candidate = _candidate(rng, label_distance_m)
        if candidate is not None:
            rows.append(candidate[0])
            labels.append(candidate[1])
    return np.array(rows), np.array(labels)


def _candidate(rng: np.random.Generator, label_distance_m: float) -> tuple[Floats, bool] | None:
    hall_m = rng.uniform(5.0, 15.0)
    landmark, other = rng.uniform(0.0, hall_m, (2, 2))
    poses = _drive(rng, hall_m)
    target = np.tile(landmark, (len(poses), 1))
    if rng.random() < 0.4:  # mismatches: a run of observations, or scattered ones
        share = rng.uniform(0.1, 0.9)
        wrong = rng.random(len(poses)) < share if rng.random() < 0.5 else np.arange(len(poses)) < share * len(poses)
        target[wrong] = other
    to_target = target - poses[:, :2]
    noise = rng.normal(0.0, math.radians(rng.uniform(0.3, 2.0)), len(poses))
    bearings = wrap_angles(np.arctan2(to_target[:, 1], to_target[:, 0]) - poses[:, 2] + noise)
    elevation = np.arctan2(rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 2.0), np.hypot(*to_target.T))
    believed = poses + rng.normal(0.0, [0.01, 0.01, 0.003], poses.shape) * rng.uniform(1.0, 5.0)
    measurement = measure_landmark(believed, bearings)
    if measurement is None:
        return None
    features = landmark_features(believed, bearings, _FOCAL_PX * (math.pi / 2 + elevation), measurement)
    return features, bool(np.hypot(*(measurement.position - landmark)) < label_distance_m)


def _drive(rng: np.random.Generator, hall_m: float) -> Floats:
    """Return the poses of a stretch of a drive, one each 0.1 m: an arc, at times with a corner."""
    length_m = float(np.exp(rng.uniform(math.log(0.2), math.log(6.0))))
    n = max(3, round(length_m / 0.1))
    turns = np.full(n, rng.choice([0.0, rng.uniform(-0.06, 0.06)]))
    if rng.random() < 0.3:
        turns[rng.integers(0, n)] += rng.choice([-1.0, 1.0]) * math.pi / 2
    theta = rng.uniform(-math.pi, math.pi) + np.cumsum(turns)
    steps = 0.1 * np.column_stack([np.cos(theta), np.sin(theta)])
    positions = rng.uniform(0.2 * hall_m, 0.8 * hall_m, 2) + np.cumsum(steps, axis=0)
    return np.column_stack([positions, wrap_angles(theta)])
