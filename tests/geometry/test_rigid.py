"""The rigid motion between two sets of points, in the plane and in space."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.errors import ShapeError
from trailmark.geometry import Pose2, Pose3
from trailmark.geometry.rigid import fit_pose2, kabsch


def test_two_points_of_a_quarter_turn() -> None:
    pose = fit_pose2(np.array([[1.0, 2.0], [1.0, 3.0]]), np.array([[0.0, 0.0], [1.0, 0.0]]))

    np.testing.assert_allclose(pose.array(), [1.0, 2.0, math.pi / 2.0], atol=1e-12)


def test_the_fits_in_the_plane_agree_with_each_other_and_with_the_pose_that_made_the_points() -> None:
    rng = np.random.default_rng(7)
    points_b, true = rng.normal(size=(30, 2)), Pose2(3.0, -1.0, 2.5)

    pose = fit_pose2(true @ points_b, points_b)
    R, t = kabsch(true @ points_b, points_b, rng.uniform(0.5, 2.0, 30))

    np.testing.assert_allclose(pose.array(), true.array(), atol=1e-12)
    np.testing.assert_allclose(np.r_[t, math.atan2(R[1, 0], R[0, 0])], true.array(), atol=1e-12)


def test_least_squares_leaves_no_better_pose_nearby() -> None:
    rng = np.random.default_rng(7)
    points_b = rng.normal(size=(20, 2))
    points_a = Pose2(1.0, 2.0, 0.5) @ points_b + rng.normal(0.0, 0.2, (20, 2))

    best = fit_pose2(points_a, points_b)

    least = np.sum((points_a - best @ points_b) ** 2)
    for step in np.concatenate([np.eye(3), -np.eye(3)]) * 1e-4:
        assert np.sum((points_a - Pose2.from_array(best.array() + step) @ points_b) ** 2) > least


def test_batches_in_space_are_each_fitted_on_their_own() -> None:
    points_b = np.random.default_rng(7).normal(size=(2, 5, 3))
    true = [Pose3(0.2, -0.1, 0.05, 0.1, -0.2, 0.3), Pose3(-1.0, 0.0, 2.0, 0.0, 1.0, -0.3)]

    R, t = kabsch(np.stack([pose.transform(b) for pose, b in zip(true, points_b)]), points_b, np.ones((2, 5)))

    np.testing.assert_allclose(R, [pose.rotation() for pose in true], atol=1e-12)
    np.testing.assert_allclose(t, [[0.2, -0.1, 0.05], [-1.0, 0.0, 2.0]], atol=1e-12)


def test_a_pair_without_weight_counts_for_nothing() -> None:
    points_b = np.random.default_rng(7).normal(size=(6, 3))
    points_a = points_b + 1.0
    points_a[0] = 99.0

    R, t = kabsch(points_a, points_b, np.array([0.0, 1.0, 1.0, 1.0, 1.0, 1.0]))

    np.testing.assert_allclose(R, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(t, 1.0, atol=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_mirrored_corner_is_never_answered_by_a_reflection(dimension: int) -> None:
    corner = np.vstack([np.zeros(dimension), np.eye(dimension)])
    mirrored = corner.copy()
    mirrored[:, -1] *= -1.0

    R, _ = kabsch(corner, mirrored, np.ones(len(corner)))

    assert np.linalg.det(R) == pytest.approx(1.0)


def test_points_that_are_no_pairs_are_refused() -> None:
    with pytest.raises(ShapeError, match=r"pairs of shape \(N, 2\), not \(3, 2\) and \(2, 2\)"):
        fit_pose2(np.zeros((3, 2)), np.zeros((2, 2)))
    with pytest.raises(ShapeError, match=r"with \(2,\) weights are no pairs"):
        kabsch(np.zeros((3, 2)), np.zeros((3, 2)), np.ones(2))
