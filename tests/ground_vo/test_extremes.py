"""The groups of reference pixels: choice, motion and jumps."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark_ground_vo.extremes import advance, select

AREA = (20, 10, 84, 58)
CENTRE = (51.5, 33.5)


@pytest.fixture
def image():
    return np.random.default_rng(7).integers(0, 256, (80, 120), np.uint8)


def test_each_line_of_the_area_gives_its_brightest_and_its_darkest_pixel(image):
    x, y, values, brightest = select(image, AREA, 128)

    area = image[10:58, 20:84]
    np.testing.assert_array_equal(values[brightest], area.max(axis=0))
    np.testing.assert_array_equal(values[~brightest], area.min(axis=0))
    np.testing.assert_array_equal(values, image[y.astype(int), x.astype(int)])
    np.testing.assert_array_equal(x[brightest], np.arange(20, 84))


def test_fewer_pixels_than_lines_are_spread_evenly(image):
    x, *_ = select(image, AREA, 32)

    assert len(x) == 32
    assert np.all(np.diff(x[::2]) == 4)


def test_pixels_move_like_a_rigid_body_and_keep_their_intensity(image):
    group = select(image, AREA, 128)
    inside = (np.abs(group[0] - CENTRE[0]) < 20) & (np.abs(group[1] - CENTRE[1]) < 12)

    x, y, values, fresh = advance(image[::-1].copy(), *group, AREA, CENTRE, (3.25, -1.5, 0.05), 1.0, 0.0)

    cos, sin = np.cos(0.05), np.sin(0.05)
    dx, dy = group[0] - CENTRE[0], group[1] - CENTRE[1]
    np.testing.assert_allclose(x[inside], (cos * dx + sin * dy + CENTRE[0] + 3.25)[inside])
    np.testing.assert_allclose(y[inside], (cos * dy - sin * dx + CENTRE[1] - 1.5)[inside])
    assert not fresh[inside].any()
    np.testing.assert_array_equal(values[~fresh], group[2][~fresh])


def test_a_pixel_that_leaves_sideways_jumps_to_the_extreme_of_the_opposite_line(image):
    group = select(image, AREA, 128)

    x, y, values, fresh = advance(image, *group, AREA, CENTRE, (9.0, 0.0, 0.0), 1.0, 0.0)

    left = group[0] + 9 > 83
    np.testing.assert_array_equal(fresh, left)
    np.testing.assert_array_equal(x[left], group[0][left] + 9 - 64)
    brightest = left & group[3]
    columns = image[10:58, x[brightest].astype(int)]
    np.testing.assert_array_equal(values[brightest], columns.max(axis=0))
    np.testing.assert_array_equal(y[brightest], 10 + columns.argmax(axis=0))


def test_a_pixel_that_leaves_over_the_edge_jumps_to_an_extreme_of_a_free_line_near_its_own(image):
    group = select(image, AREA, 128)

    x, y, values, fresh = advance(image, *group, AREA, CENTRE, (0.0, -20.0, 0.0), 1.0, 0.0)

    over = group[1] - 20 < 10
    np.testing.assert_array_equal(fresh, over)
    np.testing.assert_array_equal(y[over], group[1][over] - 20 + 48)
    assert np.all(np.abs(x[over] - group[0][over]) <= 16)
    taken = {int(u) for u in group[0][group[3] & ~over]}
    for n in np.flatnonzero(over & group[3]):
        u, v = int(group[0][n]), int(y[n])
        near = list(range(max(20, u - 16), min(84, u + 17)))
        free = [line for line in near if line not in taken]
        assert values[n] == image[v, free or near].max()
        taken.add(int(x[n]))


@pytest.mark.parametrize("motion", [(-6.4, 0.3, 0.012), (1.7, 4.3, -0.021), (0.4, -0.6, 0.035)])
def test_pixels_stay_different_ones_on_a_long_curved_drive(motion):
    """Pixels that land on one line would be one pixel from then on; a few of them would be left."""
    rng = np.random.default_rng(5)
    group = select(rng.integers(0, 256, (80, 120), np.uint8), AREA, 128)

    for _ in range(600):
        image = rng.integers(0, 256, (80, 120), np.uint8)
        x, y, values, _ = advance(image, *group, AREA, CENTRE, motion, 1.0, 0.0)
        group = (x, y, values, group[3])

    places = np.floor(np.column_stack([group[0], group[1], group[3]]) + 0.5)
    assert len(np.unique(places, axis=0)) > 100


def test_all_pixels_stay_in_the_area_whatever_the_motion(image):
    group = select(image, AREA, 128)
    rng = np.random.default_rng(3)

    for _ in range(50):
        motion = (rng.uniform(-40, 40), rng.uniform(-40, 40), rng.uniform(-0.04, 0.04))
        x, y, values, _ = advance(image, *group, AREA, CENTRE, motion, 1.0, 0.0)
        group = (x, y, values, group[3])
        assert np.all((x >= 19.5) & (x < 83.5) & (y >= 9.5) & (y < 57.5))


def test_coordinates_are_rounded_to_the_seven_bits_of_the_paper(image):
    group = select(image, AREA, 128)

    x, y, _, fresh = advance(image, *group, AREA, CENTRE, (1.0, 0.0, 1 / 128), 1.0, 128.0)

    assert not fresh.all()
    np.testing.assert_array_equal(x * 128, np.rint(x * 128))
    np.testing.assert_array_equal(y * 128, np.rint(y * 128))
