"""Kernels on whole pictures, against numpy."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from trailmark_ground_vo.filters import (
    flatten,
    levels_of,
    noise_level,
    smooth,
    smooth_plain,
    transpose,
    transpose_plain,
)

SHAPES = [(480, 512), (61, 83), (16, 16), (33, 17)]


def random_image(shape):
    return np.random.default_rng(shape[0]).integers(0, 256, shape, np.uint8)


@pytest.mark.parametrize("kernel", [transpose, transpose_plain])
@pytest.mark.parametrize("shape", SHAPES)
def test_transpose_swaps_rows_and_columns(kernel, shape):
    image = random_image(shape)

    np.testing.assert_array_equal(kernel(image), image.T)


@pytest.mark.parametrize("kernel", [smooth, smooth_plain])
@pytest.mark.parametrize("shape", SHAPES)
def test_smoothing_is_the_exact_binomial_sum_with_repeated_edges(kernel, shape):
    image = random_image(shape)
    weights = np.array([1, 4, 6, 4, 1])
    padded = np.pad(image.astype(int), 2, mode="edge")
    height, width = shape
    down = sum(w * padded[i : i + height] for i, w in enumerate(weights))
    expected = sum(w * down[:, i : i + width] for i, w in enumerate(weights))

    np.testing.assert_array_equal(kernel(image), expected)


def test_smoothing_white_reaches_the_end_of_16_bits_and_not_beyond():
    assert np.all(smooth(np.full((32, 32), 255, np.uint8)) == 255 * 256)


def test_flattening_rounds_and_stops_at_white():
    image = np.array([[0, 10, 100, 200]], np.uint8)
    gain = np.array([[512, 128, 257, 512]], np.uint16)

    np.testing.assert_array_equal(flatten(image, gain), [[0, 5, 100, 255]])


@pytest.mark.parametrize("sigma", [1.0, 3.0, 12.0])
def test_the_noise_of_a_picture_is_told_from_its_slopes_and_edges(sigma):
    rng = np.random.default_rng(5)
    v, u = np.mgrid[:240, :320]
    clean = 60.0 + 0.3 * u + 0.2 * v + 40.0 * (u > 150) + cv2.GaussianBlur(rng.normal(0.0, 60.0, u.shape), (0, 0), 6.0)
    noisy = np.clip(np.rint(clean + rng.normal(0.0, sigma, clean.shape)), 0, 255).astype(np.uint8)

    assert noise_level(noisy) == pytest.approx(math.hypot(sigma, 0.29), rel=0.08)


def test_a_blank_picture_has_no_noise():
    assert noise_level(np.full((20, 30), 77, np.uint8)) == 0.0


def test_levels_are_rounded():
    image = np.random.default_rng(6).integers(0, 256, (41, 50), np.uint8)
    smoothed = smooth_plain(image)

    assert np.array_equal(levels_of(smoothed), np.floor(smoothed / 256.0 + 0.5).astype(np.uint8))
