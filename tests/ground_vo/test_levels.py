"""The half-size picture of even brightness and one contrast."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.geometry import Pose2
from trailmark_ground_vo.levels import half_picture, levelled, seven_bits, tamed


def test_half_the_size_is_the_mean_of_four():
    image = np.array([[0, 4, 10, 10], [8, 4, 10, 30], [1, 1, 0, 0], [1, 1, 0, 2]], np.uint8)

    np.testing.assert_array_equal(half_picture(image), [[4, 15], [1, 1]])


def test_gain_offset_and_shading_make_no_difference(camera, ground):
    view = camera.view(ground, Pose2())
    shade = np.linspace(0.8, 1.0, view.shape[1])

    even = levelled(half_picture(view.astype(np.uint8)))
    changed = levelled(half_picture((0.8 * shade * view + 15.0).astype(np.uint8)))

    assert np.corrcoef(even.ravel(), changed.ravel())[0, 1] > 0.97
    assert changed.std() == pytest.approx(even.std(), rel=0.05)
    assert even.std() == pytest.approx(30.0, rel=0.2)


def test_dirt_is_neutral_in_the_search_and_does_not_spoil_its_neighbours(camera, ground):
    image = camera.view(ground, Pose2()).astype(np.uint8)
    dirty = image.copy()
    dirty[100:112, 150:162] = 255

    clean_bits, bits = (seven_bits(levelled(half_picture(picture)), True) for picture in (image, dirty))

    np.testing.assert_array_equal(bits[51:55, 76:80], 64)
    near = np.abs(bits[40:66, 65:91].astype(int) - clean_bits[40:66, 65:91])
    assert np.median(near) <= 8  # of 127


def test_shade_has_no_bright_band_along_its_edge(camera, ground):
    """A band would be found again wherever the shadow falls next."""
    half = half_picture(camera.view(ground, Pose2()).astype(np.uint8)).astype(float)
    half[:, 80:] *= 0.5

    in_the_shade = levelled(half.astype(np.uint8))[:, 85:90].astype(float) - 128.0

    assert abs(in_the_shade.mean()) < 10.0  # of 30 levels, one standard deviation of the ground


def test_seven_bits_span_their_range_and_raw_pictures_lose_one_bit():
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16)

    searched = seven_bits(levels, True).ravel()
    raw = seven_bits(levels, False).ravel()

    assert (searched.min(), searched.max(), searched[128]) == (1, 127, 64)
    assert searched[128 - 125] == searched[128 + 125] == 64
    assert np.all(np.diff(searched[98:159].astype(int)) >= 0)
    np.testing.assert_array_equal(raw, np.arange(256) // 2)


def test_the_refinement_sees_two_standard_deviations_at_most():
    levels = np.array([[0, 60, 100, 128, 150, 200, 255]], np.uint8)

    np.testing.assert_array_equal(tamed(levels), [[128, 68, 100, 128, 150, 188, 128]])


def test_a_picture_without_texture_stays_without():
    assert np.ptp(levelled(np.full((120, 128), 90, np.uint8))) == 0
