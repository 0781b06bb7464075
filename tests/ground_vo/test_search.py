"""Equations (1) and (2): the search, against plain numpy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trailmark_ground_vo.filters import transpose
from trailmark_ground_vo.search import (
    centre_out,
    places,
    reach,
    rotation_angles,
    sad_search,
    sad_search_plain,
    summarise,
)

STEP_RAD = 1 / 128
CENTRE = (63.5, 55.5)


def random_group(seed, n_pixels=60, shape=(112, 128)):
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 256, shape, np.uint8)
    x, y = rng.uniform(40, 88, n_pixels), rng.uniform(40, 72, n_pixels)
    return image, x, y, rng.integers(0, 256, n_pixels, np.uint8)


def equation_1(image, x, y, values, centre, shift, angles, search_px, aspect=1.0):
    """E(i, j, k), term by term as printed."""
    offsets = range(-search_px, search_px + 1)
    errors = np.zeros((len(angles), len(offsets), len(offsets)), np.int64)
    for k, angle in enumerate(angles):
        c, s = math.cos(angle), math.sin(angle)
        t_x = c * (x - centre[0]) + s * aspect * (y - centre[1]) + centre[0] + shift[0]
        t_y = c * (y - centre[1]) - s / aspect * (x - centre[0]) + centre[1] + shift[1]
        u, v = np.floor(t_x + 0.5).astype(int), np.floor(t_y + 0.5).astype(int)
        for j, dv in enumerate(offsets):
            for i, du in enumerate(offsets):
                errors[k, j, i] = np.abs(values.astype(int) - image[v + dv, u + du].astype(int)).sum()
    return errors


def searched(make, image, x, y, values, centre, shift, angles, search_px, aspect=1.0):
    limits = (search_px, image.shape[1] - 1 - reach(search_px), search_px, image.shape[0] - 1 - reach(search_px))
    spots = places(x, y, centre, shift, angles, aspect, limits)
    return make(search_px)(image, transpose(image), spots, values)


@pytest.mark.parametrize("make", [sad_search, sad_search_plain])
@pytest.mark.parametrize("search_px", [2, 4, 8, 12])
def test_the_kernels_compute_equation_1_bit_by_bit(make, search_px):
    image, x, y, values = random_group(seed=search_px, n_pixels=300)
    angles = rotation_angles(5, STEP_RAD)

    errors = searched(make, image, x, y, values, CENTRE, (3.0, -2.0), angles, search_px)

    np.testing.assert_array_equal(errors, equation_1(image, x, y, values, CENTRE, (3.0, -2.0), angles, search_px))


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    shift=st.tuples(st.integers(-9, 9), st.integers(-9, 9)),
    aspect=st.floats(0.9, 1.1),
    n_pixels=st.integers(1, 520),
)
def test_vectors_and_plain_loops_give_the_same_bits(seed, shift, aspect, n_pixels):
    image, x, y, values = random_group(seed, n_pixels)
    arguments = (image, x, y, values, CENTRE, shift, rotation_angles(2, STEP_RAD), 8, aspect)

    np.testing.assert_array_equal(searched(sad_search, *arguments), searched(sad_search_plain, *arguments))


def test_sums_do_not_overflow_when_every_difference_is_the_largest():
    image = np.zeros((112, 128), np.uint8)
    _, x, y, _ = random_group(1, n_pixels=768)

    errors = searched(sad_search, image, x, y, np.full(768, 255, np.uint8), CENTRE, (0.0, 0.0), np.zeros(1), 8)

    assert np.all(errors == 768 * 255)


def test_the_minimum_is_where_a_shifted_and_turned_picture_lies():
    image, x, y, _ = random_group(3, n_pixels=400)
    turned = places(x, y, CENTRE, (5.0, -3.0), np.array([2 * STEP_RAD]), 1.0, (0, 127, 0, 111))
    values = image[turned[1, 0], turned[0, 0]]

    errors = searched(sad_search, image, x, y, values, CENTRE, (1.0, 0.0), rotation_angles(5, STEP_RAD), 8)

    k, j, i, least, mean = summarise(errors, centre_out(11, 17))
    assert (k - 5, j - 8, i - 8, least) == (2, -3, 4, 0)
    assert mean == pytest.approx(errors.mean())


def test_of_equal_minima_the_smallest_turn_and_then_the_smallest_shift_wins():
    errors = np.full((3, 5, 5), 7, np.int32)

    assert summarise(errors, centre_out(3, 5))[:3] == (1, 2, 2)
    errors[:, 2, 2] = 8
    assert summarise(errors, centre_out(3, 5))[0] == 1
    errors[1] = 8
    k, j, i = summarise(errors, centre_out(3, 5))[:3]
    assert (k, abs(j - 2) + abs(i - 2)) == (0, 1)


def test_ranks_number_every_candidate_once():
    ranks = centre_out(11, 17)

    assert sorted(ranks.ravel().tolist()) == list(range(11 * 17 * 17))
    assert ranks[5, 8, 8] == 0


def test_places_are_the_nearest_pixels_after_turn_and_shift():
    x, y = np.array([10.0, 14.0]), np.array([10.0, 10.0])

    spots = places(x, y, (10.0, 10.0), (2.0, 1.0), np.array([0.0, math.pi / 6]), 1.0, (0, 99, 0, 99))

    np.testing.assert_array_equal(spots[:, 0], [[12, 16], [11, 11]])
    # (4, 0) turns to (4 cos 30, -4 sin 30) = (3.46, -2): counter-clockwise on the screen
    np.testing.assert_array_equal(spots[:, 1], [[12, 15], [11, 9]])


def test_places_outside_the_limits_are_moved_inside():
    x, y, limits = np.array([-50.0, 500.0]), np.array([500.0, -50.0]), (8, 90, 9, 80)

    spots = places(x, y, (0.0, 0.0), (0.0, 0.0), np.zeros(1), 1.0, limits)

    np.testing.assert_array_equal(spots[:, 0], [[8, 90], [80, 9]])


def test_turns_are_rigid_on_the_ground_when_pixels_are_not_square():
    aspect = 1.25  # a pixel is 1 wide and 1.25 high
    angles, limits = np.array([-math.pi / 2]), (-99, 99, -99, 99)

    spots = places(np.array([40.0]), np.array([0.0]), (0.0, 0.0), (0.0, 0.0), angles, aspect, limits)

    np.testing.assert_array_equal(spots[:, 0, 0], [0, 32])
