"""Errors of sightings that last: they are told, and do not average out."""

from __future__ import annotations

import math

import numpy as np

from trailmark import Pipeline
from trailmark.arrays import Floats
from trailmark.frames import Frame, Odometry, Record, SensorInfo
from trailmark.geometry import Pose2

ANGLES = np.radians([10.0, 75.0, 130.0, 190.0, 245.0, 310.0])
BEACONS = np.stack([8.0 * np.cos(ANGLES), 6.0 * np.sin(ANGLES)], axis=1)


def drive(
    kind: str, *, map_scale: float = 1.0, off_m: Floats | float = 0.0, beacons: Floats = BEACONS, seed: int = 11
) -> tuple[Floats, Floats, set[str]]:
    """Return errors in metres and in sigmas of 40 s of beliefs, and what was said of health."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 40.0, 0.1)
    x, y = 3.0 * np.sin(0.15 * t), 2.4 * np.sin(0.23 * t)
    true = np.stack([x, y, np.unwrap(np.arctan2(np.gradient(y), np.gradient(x)))], axis=1)
    places = {index + 1: tuple((place * map_scale).tolist()) for index, place in enumerate(beacons)}
    config = {
        "localizers": {"wheels": "odometry", "tags": {"plugin": "known_landmarks", "landmarks": places}},
        "estimator": "kalman",
        "start": [float(x[0]), float(y[0]), math.degrees(true[0, 2])],
    }
    wheels, errors, health = Pose2(), [], set()
    with Pipeline(config, sensors=[SensorInfo("wheels", "odometry"), SensorInfo("tags", kind)]) as pipeline:
        for index, pose in enumerate(true):
            step = Pose2.from_array(true[max(index - 1, 0)]).between(Pose2.from_array(pose))
            wheels = wheels @ Pose2(step.x * 1.01, step.y, step.theta * 1.01 + rng.normal() * 1e-3)
            pipeline.feed(Frame("wheels", t[index] + 1.0, Odometry(wheels)))
            if index % 2:
                continue
            to = beacons - pose[:2]
            arrays = {"ids": np.arange(1, len(beacons) + 1)}
            arrays["ranges_m"] = np.hypot(*to.T) + rng.normal(size=len(to)) * 0.05 + off_m
            if kind == "range_bearing":
                angles = np.arctan2(to[:, 1], to[:, 0]) - pose[2] + rng.normal(size=len(to)) * 0.012
                arrays["bearings_rad"] = np.arctan2(np.sin(angles), np.cos(angles))
            step_of = pipeline.feed(Frame("tags", t[index] + 1.0, Record(arrays)))
            belief = step_of.belief
            assert belief.pose_map_base is not None
            assert belief.covariance is not None
            off = belief.pose_map_base.array()[:2] - pose[:2]
            sigmas = math.sqrt(float(off @ np.linalg.solve(belief.covariance[:2, :2], off)))
            errors.append((float(np.hypot(*off)), sigmas))
            health |= {words for words in [belief.health.get("tags", "")] if words}
    away, sigmas = np.array(errors).T
    return away, sigmas, health


def test_honest_landmarks_are_as_good_as_ever_and_nothing_is_said() -> None:
    away, sigmas, health = drive("range_bearing")
    assert np.median(away) < 0.03
    assert sigmas.max() < 4.5
    assert not health


def test_a_map_that_is_too_small_makes_poses_wide_and_is_said() -> None:
    away, sigmas, health = drive("range_bearing", map_scale=1.0 / 1.07)
    assert np.median(away) > 0.1
    assert (sigmas > 5.0).mean() < 0.1
    assert any("ranges are 7% longer than the map says" in words for words in health)


def test_a_range_that_is_lastingly_too_long_is_named_and_counts_for_less() -> None:
    away, sigmas, health = drive("range_bearing", off_m=np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    assert np.median(away) < 0.06
    assert (sigmas > 5.0).mean() < 0.05
    assert any(words.startswith("landmarks that are lastingly off: 1 (range +") for words in health)


def test_half_of_the_ranges_behind_walls_make_the_belief_wide() -> None:
    _, sigmas, _ = drive("range", off_m=np.array([1.0, 0.0, 1.0, 0.0]), beacons=BEACONS[[0, 1, 3, 4]])
    assert (sigmas > 5.0).mean() < 0.05
