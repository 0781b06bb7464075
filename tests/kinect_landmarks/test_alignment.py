"""Pose from two landmarks and from many, in the plane and in space."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trailmark.errors import ShapeError
from trailmark.geometry import Pose2, Pose3
from trailmark_kinect_landmarks.alignment import (
    AlignmentLimits,
    CloudAlignment,
    Refusal,
    align,
    planar_covariance,
    pose_from_two,
)
from trailmark_kinect_landmarks.expectation import Expected

Array = npt.NDArray[np.float64]
SIGMA_M = 0.01


def _covariances(n: int, dimension: int, sigma_m: float = SIGMA_M) -> Array:
    return np.tile(np.eye(dimension) * sigma_m**2, (n, 1, 1))


def _aligned(points_a: Array, points_b: Array, **options: object) -> CloudAlignment | Refusal:
    n, dimension = points_a.shape
    cov = _covariances(n, dimension)
    return align(points_a, points_b, cov, cov, rng=np.random.default_rng(7), **options)  # type: ignore[arg-type]


def _room(n: int, dimension: int, seed: int = 7) -> Array:
    rng = np.random.default_rng(seed)
    return np.asarray(rng.uniform([1.0, -1.5, -1.0], [4.0, 1.5, 1.0], (n, 3))[:, :dimension])


def test_two_landmarks_worked_by_hand() -> None:
    # The robot turned left by 90 deg and stands 1 m ahead: what was at (2, 1) is now at (1, -1).
    pose = pose_from_two(np.array([2.0, 1.0]), np.array([1.0, 2.0]), np.array([1.0, -1.0]), np.array([2.0, 0.0]))

    np.testing.assert_allclose(pose.array(), [1.0, 0.0, math.pi / 2], atol=1e-9)


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(-3.1, 3.1))
@settings(max_examples=40, deadline=None)
def test_two_landmarks_give_back_any_motion(x: float, y: float, theta: float) -> None:
    true = Pose2(x, y, theta)
    start = np.array([[2.0, 1.0], [1.5, -0.7]])
    now = true.inverse() @ start

    pose = pose_from_two(start[0], start[1], now[0], now[1])

    np.testing.assert_allclose(true.between(pose).array(), 0.0, atol=1e-9)


def test_two_landmarks_by_alignment_are_the_closed_form() -> None:
    start = np.array([[2.0, 1.0], [1.5, -0.7]])
    now = Pose2(0.1, 0.05, 0.2).inverse() @ start + [[0.001, 0.0], [0.0, -0.001]]

    found = _aligned(start, now)

    assert isinstance(found, CloudAlignment)
    closed = pose_from_two(start[0], start[1], now[0], now[1])
    np.testing.assert_allclose(found.t, [closed.x, closed.y], atol=1e-9)
    assert math.atan2(found.R[1, 0], found.R[0, 0]) == pytest.approx(closed.theta, abs=1e-9)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_motion_is_found_among_a_third_of_wrong_landmarks(dimension: int) -> None:
    true = Pose3(0.3, -0.2, 0.1, 0.0, 0.0, 0.4) if dimension == 2 else Pose3(0.3, -0.2, 0.1, 0.05, -0.1, 0.4)
    now = _room(18, dimension)
    R, t = true.rotation()[:dimension, :dimension], np.array([true.x, true.y, true.z])[:dimension]
    start = now @ R.T + t
    start[:6] += np.random.default_rng(3).uniform(0.2, 0.6, (6, dimension))

    found = _aligned(start, now)

    assert isinstance(found, CloudAlignment)
    np.testing.assert_allclose(found.R, R, atol=1e-9)
    np.testing.assert_allclose(found.t, t, atol=1e-9)
    assert found.inliers.tolist() == [False] * 6 + [True] * 12


@pytest.mark.parametrize(
    ("now", "reason"),
    [
        ([[2.0, 0.5]], "1 landmarks agree, 2 are needed"),
        ([[2.0, 0.1], [2.0, -0.1]], "only 0.20 m apart, less than 0.3 m"),
        ([[2.0, 0.1], [4.0, 0.2]], "in line with the camera"),
    ],
)
def test_degenerate_landmarks_are_refused(now: list[list[float]], reason: str) -> None:
    points = np.array(now)

    found = _aligned(points, points)

    assert isinstance(found, Refusal)
    assert reason in found.reason


def test_landmarks_on_one_line_leave_a_turn_open_in_space() -> None:
    points = np.array([[2.0, -1.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [2.0, 0.5, 0.0]])

    found = _aligned(points, points)

    assert isinstance(found, Refusal)
    assert "on one line" in found.reason


def test_more_landmarks_can_be_demanded() -> None:
    points = _room(4, 2)

    found = _aligned(points, points, limits=AlignmentLimits(min_landmarks=5))

    assert found == Refusal("4 landmarks agree, 5 are needed")


def test_arrays_that_do_not_belong_together_are_refused() -> None:
    with pytest.raises(ShapeError, match="do not belong together"):
        _aligned(_room(4, 2), _room(5, 2))


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_covariance_is_what_noise_does(dimension: int) -> None:
    rng = np.random.default_rng(11)
    truth = _room(12, dimension)
    cov = _covariances(12, dimension)
    errors, told = [], []

    for _ in range(150):
        noisy = (truth + rng.normal(0.0, SIGMA_M, truth.shape) for _ in range(2))
        found = align(*noisy, cov, cov, rng=rng)
        assert isinstance(found, CloudAlignment)
        errors.append([found.t[0], found.t[1], math.atan2(found.R[1, 0], found.R[0, 0])])
        told.append(np.diag(planar_covariance(found)))

    np.testing.assert_allclose(np.std(errors, axis=0), np.sqrt(np.mean(told, axis=0)), rtol=0.25)


def test_a_landmark_with_poor_depth_counts_by_its_direction() -> None:
    now = np.array([[3.0, -1.0], [3.0, 1.0], [2.0, 0.0]])
    start = now + np.array([[0.3, -0.1], [0.3, 0.1], [0.0, 0.0]])  # the first two miss along their rays
    cov = np.zeros((3, 2, 2))
    for i, point in enumerate(now):
        ray = point / np.linalg.norm(point)
        cov[i] = 1e-6 * np.eye(2) + (0.2**2 if i < 2 else 1e-6) * np.outer(ray, ray)

    found = align(
        start,
        now,
        cov,
        cov,
        rng=np.random.default_rng(7),
        expected=Expected(np.eye(2), np.zeros(2), np.full(2, 0.05), 0.05),
    )

    assert isinstance(found, CloudAlignment)
    np.testing.assert_allclose(found.t, 0.0, atol=0.01)  # 1 cm, although two of three miss by 0.32 m
