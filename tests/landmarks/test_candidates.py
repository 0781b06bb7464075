"""Poses in closed form hold exactly for the numbers that they are made of."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from trailmark.arrays import Floats
from trailmark_landmarks.candidates import candidate_poses, pose_from_three_bearings, poses_from_two_ranges

COORDINATES = st.floats(-20.0, 20.0)
POINTS = st.tuples(COORDINATES, COORDINATES)


def seen_from(pose: Floats, landmarks: Floats) -> tuple[Floats, Floats]:
    offsets = landmarks - pose[:2]
    bearings = np.arctan2(offsets[:, 1], offsets[:, 0]) - pose[2]
    return np.hypot(offsets[:, 0], offsets[:, 1]), np.arctan2(np.sin(bearings), np.cos(bearings))


def circumcircle_determinant(points: Floats) -> float:
    """Zero where four points lie on one circle, or on a line."""
    rows = np.column_stack([points, (points**2).sum(axis=1), np.ones(4)])
    return float(np.linalg.det(rows / np.maximum(np.linalg.norm(rows, axis=0), 1e-300)))


@given(st.lists(POINTS, min_size=3, max_size=3, unique=True), POINTS, st.floats(-math.pi, math.pi))
@example([(0.0, 0.0), (0.0, 20.0), (0.0, 0.25)], (0.0, 1.0), 0.0)
def test_three_bearings_tell_the_pose_unless_all_lie_on_a_circle(
    landmarks: list[tuple[float, float]], place: tuple[float, float], heading: float
) -> None:
    places = np.array(landmarks)
    assume(min(math.dist(place, landmark) for landmark in landmarks) > 0.1)
    assume(abs(circumcircle_determinant(np.vstack([places, place]))) > 1e-4)
    pose = np.array([*place, heading])
    _, bearings = seen_from(pose, places)
    assume(min(abs(math.sin(bearings[i] - bearings[j])) for i, j in ((0, 1), (1, 2), (0, 2))) > 1e-3)
    found = pose_from_three_bearings(places, bearings)
    assert found is not None
    np.testing.assert_allclose(found[:2], place, atol=1e-3)
    assert math.cos(found[2] - heading) > 1.0 - 1e-6


def test_no_pose_where_robot_and_landmarks_lie_on_a_circle() -> None:
    angles = np.array([0.3, 1.9, 3.8])
    landmarks = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    _, bearings = seen_from(np.array([0.0, -1.0, 0.4]), landmarks)
    assert pose_from_three_bearings(landmarks, bearings) is None


@given(POINTS, POINTS, POINTS)
def test_one_of_two_circles_crossings_is_the_place(
    first: tuple[float, float], second: tuple[float, float], place: tuple[float, float]
) -> None:
    assume(math.dist(first, second) > 0.5)
    landmarks = np.array([first, second])
    ranges = np.array([math.dist(place, first), math.dist(place, second)])
    found = poses_from_two_ranges(landmarks, ranges)
    assert min(math.dist(candidate, place) for candidate in found) < 1e-4


def test_two_landmarks_in_one_place_tell_nothing() -> None:
    assert poses_from_two_ranges(np.ones((2, 2)), np.array([1.0, 2.0])) == []


@pytest.mark.parametrize("hidden", ["nothing", "bearings but one", "ranges"])
def test_candidates_of_exact_sightings_hold_the_pose(hidden: str) -> None:
    rng = np.random.default_rng(0)
    landmarks, pose = rng.uniform(-5.0, 5.0, (5, 2)), np.array([0.4, -0.7, 2.0])
    ranges, bearings = seen_from(pose, landmarks)
    if hidden == "ranges":
        ranges[:] = np.nan
    elif hidden == "bearings but one":
        bearings[1:] = np.nan
    candidates = candidate_poses(landmarks, ranges, bearings)
    misses = candidates - pose
    misses[:, 2] = np.arctan2(np.sin(misses[:, 2]), np.cos(misses[:, 2]))
    assert np.abs(misses).max(axis=1).min() < 1e-6


def test_many_landmarks_do_not_make_endless_candidates() -> None:
    rng = np.random.default_rng(0)
    landmarks = rng.uniform(-50.0, 50.0, (200, 2))
    ranges, bearings = seen_from(np.zeros(3), landmarks)
    assert len(candidate_poses(landmarks, ranges, bearings)) <= 4 * 120 + 4


def test_two_thousand_sightings_take_no_longer_than_sixty() -> None:
    rng = np.random.default_rng(0)
    pose = np.array([1.0, 2.0, 0.3])
    landmarks = rng.uniform(-20.0, 20.0, (2000, 2))
    begin_s = time.process_time()
    candidates = candidate_poses(landmarks, *seen_from(pose, landmarks))
    assert time.process_time() - begin_s < 1.0
    assert len(candidates) > 100
    assert np.abs(candidates[:, :2] - pose[:2]).max(axis=1).min() < 1e-6
