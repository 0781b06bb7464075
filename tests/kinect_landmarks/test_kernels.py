"""The kernels say what their plain twins in numpy say."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from trailmark_kinect_landmarks.alignment import jacobian
from trailmark_kinect_landmarks.depth import DepthLimits, correct_depth
from trailmark_kinect_landmarks.kernels import (
    best_pixels,
    colour_counts,
    keep_apart,
    normal_equations,
    whitened_misses,
    widest_pair,
)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


def test_the_best_pixel_of_a_box_is_the_first_of_its_greatest(rng: np.random.Generator) -> None:
    marks = rng.integers(0, 9, (40, 50)).astype(np.float32)
    boxes = np.column_stack([rng.uniform(-10, 50, 60), rng.uniform(-10, 40, 60), rng.uniform(1, 30, (60, 2))])

    uv, strength = best_pixels(marks, boxes, 20.0, 2.0)

    for box, pixel, best in zip(boxes, uv, strength):
        (u, v), half = box[:2] + (box[2:] - 1.0) / 2.0, np.minimum(box[2:], 20.0) / 2.0 + 2.0
        u0, v0 = max(0, int(u - half[0])), max(0, int(v - half[1]))
        window = marks[v0 : max(0, int(v + half[1]) + 1), u0 : max(0, int(u + half[0]) + 1)]
        if window.size == 0:
            assert best == 0.0
            continue
        row, column = divmod(int(window.argmax()), window.shape[1])
        assert (*pixel, best) == (u0 + column, v0 + row, window.max())


def test_what_is_kept_lies_apart_and_what_is_left_out_does_not(rng: np.random.Generator) -> None:
    uv, taken, order = rng.uniform(0, 100, (80, 2)), rng.uniform(0, 100, (5, 2)), rng.permutation(80)

    kept = keep_apart(uv, order, taken, 10.0, 80)

    before = list(taken)
    for row in order:
        is_free = all(np.abs(uv[row] - other).max() >= 10.0 for other in before)
        assert (row in kept) == is_free
        before += [uv[row]] if is_free else []
    np.testing.assert_array_equal(keep_apart(uv, order, taken, 10.0, 7), kept[:7])


def test_colours_are_counted_in_a_square_that_ends_at_the_border(rng: np.random.Generator) -> None:
    index = rng.integers(0, 28, (30, 40)).astype(np.uint8)

    counts = colour_counts(index, np.array([[20, 15], [0, 0], [45, 29]]), 4, 28)

    windows = index[11:20, 16:25], index[:5, :5], index[25:, 35:]
    np.testing.assert_array_equal(counts, [np.bincount(window.ravel(), minlength=28) for window in windows])


@pytest.mark.parametrize("D", [2, 3])
def test_the_widest_pair_is_that_of_all_pairs(rng: np.random.Generator, D: int) -> None:
    points = rng.normal(1.0, 1.0, (9, D))

    separation_m, cosine = widest_pair(points)

    rays = points / np.linalg.norm(points, axis=1)[:, None]
    assert separation_m == pytest.approx(np.linalg.norm(points[:, None] - points, axis=2).max())
    assert cosine == pytest.approx((rays @ rays.T).min())


@pytest.mark.parametrize("D", [2, 3])
def test_a_step_is_that_of_least_squares_by_the_inverse_covariances(rng: np.random.Generator, D: int) -> None:
    a, b = rng.normal(2.0, 1.0, (2, 7, D))
    roots = rng.normal(0.0, 0.1, (2, 7, D, D))
    cov_a, cov_b = roots @ roots.transpose(0, 1, 3, 2) + 1e-3 * np.eye(D)
    R, t, weights = np.linalg.qr(rng.normal(size=(D, D)))[0], rng.normal(size=D), rng.uniform(0.1, 1.0, 7)
    weights[2] = 0.0

    misses, whitening, squared = whitened_misses(a, b, cov_a, cov_b, R, t)
    weighted, gradient, full = normal_equations(b @ R.T, misses, whitening, weights)

    residuals, inverse, J = a - b @ R.T - t, np.linalg.inv(cov_a + R @ cov_b @ R.T), jacobian(b @ R.T)
    np.testing.assert_allclose(squared, np.einsum("ni,nij,nj->n", residuals, inverse, residuals))
    np.testing.assert_allclose(weighted, np.einsum("n,nip,nij,njq->pq", weights, J, inverse, J))
    np.testing.assert_allclose(gradient, np.einsum("n,nip,nij,nj->p", weights, J, inverse, residuals))
    np.testing.assert_allclose(full, np.einsum("n,nip,nij,njq->pq", weights > 0.0, J, inverse, J))


def test_corrected_depth_is_that_of_its_rules_pixel_by_pixel(rng: np.random.Generator) -> None:
    limits = DepthLimits()
    depth_m = cv2.GaussianBlur(rng.uniform(-2.0, 9.0, (60, 80)).astype(np.float32), (0, 0), 3.0)
    depth_m += rng.normal(0.0, 0.03, depth_m.shape).astype(np.float32)
    depth_m[rng.random(depth_m.shape) < 0.3] = np.nan
    depth_m[20, 20:24] = np.float32([limits.near_m, limits.far_m, limits.near_m, limits.far_m])
    grey = cv2.GaussianBlur(rng.integers(0, 255, depth_m.shape).astype(np.uint8), (0, 0), 1.0)
    grey[30:34, 40:44] = 255

    corrected = correct_depth(depth_m, grey, limits)

    known = (depth_m > limits.near_m) & (depth_m < limits.far_m)
    depth = np.where(known, depth_m, np.float32(0.0))
    median, share = cv2.medianBlur(depth, 5), cv2.blur(known.astype(np.float32), (5, 5))
    flies = known & (np.abs(depth - median) > limits.flying_share * median)
    filled = (~known | flies) & (share > 0.6) & (median > 0.0)
    expected = np.where(filled, median, np.where(known & ~flies, depth, np.float32(np.nan)))
    expected[(cv2.dilate(grey, np.ones((5, 5), np.uint8)) >= 250) & (share < 0.5)] = np.nan
    assert 0.1 < np.isfinite(expected).mean() < 0.9
    np.testing.assert_array_equal(corrected, expected)
