from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from trailmark_divs.difference import (
    column_counts,
    column_means,
    difference_image,
    otsu_threshold,
    percentile_threshold,
)

PICTURE = arrays(np.uint8, (7, 23))


def difference_of(previous, current):
    difference = np.empty_like(previous)
    histogram = difference_image(previous, current, difference)
    return difference, histogram


@given(PICTURE, PICTURE)
def test_difference_and_histogram_agree_with_numpy(previous, current):
    difference, histogram = difference_of(previous, current)

    expected = np.abs(previous.astype(int) - current.astype(int))
    np.testing.assert_array_equal(difference, expected)
    np.testing.assert_array_equal(histogram, np.bincount(expected.ravel(), minlength=256))


@given(PICTURE)
def test_otsu_threshold_agrees_with_opencv(picture):
    histogram = np.bincount(picture.ravel(), minlength=256)

    threshold, _ = cv2.threshold(picture, 0, 1, cv2.THRESH_OTSU)

    assert otsu_threshold(histogram) == int(threshold)


def test_otsu_threshold_of_a_picture_agrees_with_opencv():
    rng = np.random.default_rng(7)
    picture = np.clip(rng.normal(np.where(np.arange(640) < 90, 60, 8), 9, (240, 640)), 0, 255).astype(np.uint8)

    threshold, _ = cv2.threshold(picture, 0, 1, cv2.THRESH_OTSU)

    assert otsu_threshold(np.bincount(picture.ravel(), minlength=256)) == int(threshold)


def test_otsu_threshold_of_an_empty_histogram_is_zero():
    assert otsu_threshold(np.zeros(256, dtype=np.int64)) == 0


@given(arrays(np.int64, 256, elements=st.integers(0, 50)), st.floats(0.01, 0.99))
def test_percentile_threshold_is_the_smallest_that_enough_pixels_do_not_exceed(histogram, share):
    histogram[3] += 1

    threshold = percentile_threshold(histogram, share)

    assert histogram[: threshold + 1].sum() >= share * histogram.sum()
    assert histogram[:threshold].sum() < share * histogram.sum()


@given(PICTURE, st.integers(0, 255))
def test_column_counts_agree_with_numpy_and_drop_the_right_remainder(picture, threshold):
    counts = column_counts(picture, threshold, 5, 4)

    expected = (picture[:, :20] > threshold).reshape(7, 5, 4).sum(axis=(0, 2))
    np.testing.assert_array_equal(counts, expected)


@given(PICTURE)
def test_column_means_agree_with_numpy(picture):
    means = column_means(picture, np.full(5, 28), 4)

    np.testing.assert_allclose(means, picture[:, :20].reshape(7, 5, 4).mean(axis=(0, 2)), atol=1e-12)


@pytest.mark.parametrize("height", [1, 300])
def test_counts_do_not_overflow_in_tall_pictures(height):
    picture = np.full((height, 500), 255, dtype=np.uint8)

    assert column_counts(picture, 254, 2, 250).tolist() == [height * 250] * 2
