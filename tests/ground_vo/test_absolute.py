"""Eq. (1) for patches, against plain numpy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trailmark_ground_vo.absolute import group_places, patch_search, patch_search_plain, quadrants

MIDDLE = (63.5, 59.5)


def random_case(seed, side, n_angles, shape=(120, 128)):
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 128, shape).astype(np.int8)
    values = quadrants(rng.integers(0, 128, (side, side)).astype(np.int8))
    v, u = np.mgrid[:side, :side] - (side - 1) / 2.0
    angles = (np.arange(n_angles) - n_angles // 2) / 128
    spots = group_places(quadrants(u), quadrants(v), MIDDLE, angles, 1.0, (0, 127, 0, 119))
    return image, spots, values


def equation_1(image, spots, values, shift_px):
    size = 2 * shift_px + 1
    errors = np.zeros((*spots.shape[1:3], size, size), np.int64)
    for j in range(size):
        for i in range(size):
            seen = image[spots[1] + j - shift_px, spots[0] + i - shift_px].astype(int)
            errors[..., j, i] = np.abs(seen - values[:, None, :]).sum(axis=-1)
    return errors


@pytest.mark.parametrize("make", [patch_search, patch_search_plain])
@pytest.mark.parametrize(("shift_px", "side", "n_angles"), [(32, 44, 2), (16, 22, 5), (4, 44, 3), (5, 12, 2)])
def test_the_kernels_compute_equation_1_bit_by_bit(make, shift_px, side, n_angles):
    image, spots, values = random_case(shift_px, side, n_angles)

    errors = make(shift_px)(image, np.ascontiguousarray(image.T), spots, values)

    np.testing.assert_array_equal(errors, equation_1(image, spots, values, shift_px))


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), side=st.sampled_from([12, 22, 26, 40]))
def test_vectors_and_plain_loops_give_the_same_bits(seed, side):
    image, spots, values = random_case(seed, side, 3)
    image_t = np.ascontiguousarray(image.T)

    np.testing.assert_array_equal(
        patch_search(16)(image, image_t, spots, values), patch_search_plain(16)(image, image_t, spots, values)
    )


def test_sums_do_not_overflow_when_every_difference_is_the_largest():
    _, spots, values = random_case(1, 44, 1)

    errors = patch_search(32)(
        np.zeros((120, 128), np.int8), np.zeros((128, 120), np.int8), spots, np.full_like(values, 127)
    )

    assert np.all(errors == 484 * 127)


def test_quadrants_are_upper_left_upper_right_lower_left_lower_right():
    np.testing.assert_array_equal(
        quadrants(np.arange(16).reshape(4, 4)), [[0, 1, 4, 5], [2, 3, 6, 7], [8, 9, 12, 13], [10, 11, 14, 15]]
    )


def test_groups_turn_about_the_centre_that_they_share():
    u, v = np.array([[10.0], [-10.0]]), np.array([[0.0], [0.0]])

    spots = group_places(u, v, (50.0, 40.0), np.array([math.pi / 2]), 1.0, (0, 99, 0, 99))

    np.testing.assert_array_equal(spots[:, :, 0, 0], [[50, 50], [30, 50]])


def test_places_beyond_the_limits_are_moved_inside():
    u, v = np.array([[-90.0, 90.0]]), np.array([[90.0, -90.0]])

    spots = group_places(u, v, (50.0, 40.0), np.zeros(1), 1.0, (4, 95, 5, 70))

    np.testing.assert_array_equal(spots[:, 0, 0], [[4, 95], [70, 5]])
