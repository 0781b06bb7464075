"""Even light, and nothing where something other than the ground is seen."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from trailmark.geometry import Pose2
from trailmark_ground_vo.brightness import EVEN_LEVEL, even_brightness
from trailmark_ground_vo.cleaning import in_even_light


@pytest.fixture
def picture(camera, ground):
    return camera.image(ground, Pose2(0.3, 0.2, 0.5))


@pytest.mark.parametrize("gain", [0.4, 0.8, 1.5])
def test_a_gain_changes_nothing(gain, picture):
    lit = np.clip(gain * picture.astype(float), 0, 255).astype(np.uint8)

    difference = even_brightness(lit).astype(float) - even_brightness(picture)

    assert abs(difference.mean()) < 1.0
    assert difference.std() < 2.0  # rounding, at a gain of up to 2.5


def test_light_that_falls_off_to_one_side_is_even_afterwards(picture):
    shade = np.linspace(0.5, 1.0, picture.shape[1])[None, :]

    even = even_brightness((shade * picture).astype(np.uint8)).astype(float)

    assert even.mean() == pytest.approx(EVEN_LEVEL, abs=2.0)
    np.testing.assert_allclose(even[:, :80].mean(), even_brightness(picture)[:, :80].mean(), atol=4.0)  # was half


def test_light_that_bends_is_even_afterwards():
    # mains light under a rolling shutter: one wave over the height of the picture
    rows = 1.0 + 0.3 * np.sin(2.0 * np.pi * np.arange(480) / 480.0)

    even = even_brightness(np.tile(np.rint(110.0 * rows)[:, None], (1, 512)).astype(np.uint8)).astype(float)

    bands = even[64:-64].reshape(22, -1).mean(axis=1)  # a filter is one-sided at the edges
    assert np.ptp(bands) < 0.025 * EVEN_LEVEL


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("readout_ms", [15.0, 20.0, 25.0, 33.0])
@pytest.mark.parametrize("depth", [0.1, 0.3, 0.6])
def test_the_bands_of_a_slow_shutter_are_even_afterwards(axis, readout_ms, depth):
    waves = 1.0 + depth * np.sin(2.0 * np.pi * 0.1 * readout_ms * np.arange(480) / 480.0)
    noise = np.random.default_rng(0).normal(0.0, 3.0, (480, 480))

    even = even_brightness(np.rint(110.0 * np.expand_dims(waves, 1 - axis) + noise).astype(np.uint8)).astype(float)

    bands = np.moveaxis(even, axis, 0)[64:-64].reshape(44, -1).mean(axis=1)  # a filter is one-sided at the edges
    assert np.ptp(bands) < 0.1 * 2.0 * depth * EVEN_LEVEL  # a tenth of the swing


def test_rows_of_boards_are_no_bands(picture):
    joints = picture.copy()
    joints[::96] //= 2
    joints[1::96] //= 2

    left = even_brightness(joints).astype(float) - even_brightness(picture)

    assert left[96].mean() < -30.0  # the joint is seen
    assert np.abs(left[40:60]).mean() < 2.0


@pytest.mark.parametrize("left_of_light", [0.4, 0.5, 0.6])
@pytest.mark.parametrize("place_px", [0, 5, 8])
@pytest.mark.parametrize("turn_rad", [0.3, 0.7, 1.2])
def test_the_edge_of_a_shadow_is_neutral_and_the_ground_beside_it_is_as_it_was(left_of_light, place_px, turn_rad):
    ground = 150.0 + np.random.default_rng(0).normal(0.0, 8.0, (480, 512))
    v, u = np.mgrid[:480, :512] - np.array([240, 256])[:, None, None]
    to_edge = math.cos(turn_rad) * u + math.sin(turn_rad) * v - place_px

    even = even_brightness(np.rint(ground * np.where(to_edge < 0.0, 1.0, left_of_light)).astype(np.uint8)).astype(float)

    far, all_pixels = np.abs(to_edge) > 60.0, even - EVEN_LEVEL
    plain = EVEN_LEVEL * ground / 150.0
    assert np.corrcoef(even[far], plain[far])[0, 1] > 0.96
    assert np.std(all_pixels[np.abs(to_edge) < 40.0]) < 1.1 * np.std(plain)


@pytest.mark.parametrize("left_of_light", [0.4, 0.7])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_shadow_along_the_rows_leaves_the_ground_on_both_sides(left_of_light, axis):
    ground = 150.0 + np.random.default_rng(0).normal(0.0, 8.0, (480, 480))
    shade = np.expand_dims(np.where(np.arange(480) < 245, 1.0, left_of_light), 1 - axis)

    even = even_brightness(np.rint(ground * shade).astype(np.uint8)).astype(float)

    far = np.abs(np.arange(480) - 245) > 24
    plain = np.compress(far, ground, axis).ravel()
    assert np.corrcoef(np.compress(far, even, axis).ravel(), plain)[0, 1] > 0.97


@pytest.mark.parametrize("sigma_px", [80.0, 120.0])
def test_the_light_of_a_headlamp_is_even_afterwards_and_nothing_is_faded(sigma_px):
    ground = 150.0 + np.random.default_rng(0).normal(0.0, 8.0, (480, 512))
    v, u = np.mgrid[:480, :512] - np.array([240, 256])[:, None, None]
    lamp = 0.1 + 0.9 * np.exp(-(u**2 + v**2) / (2.0 * sigma_px**2))

    even = even_brightness(np.rint(ground * lamp).astype(np.uint8)).astype(float)

    lit = lamp > 0.25  # below, 256 grey levels are too few
    assert np.corrcoef(even[lit], ground[lit])[0, 1] > 0.9


@pytest.mark.parametrize("shape", [(3, 3), (5, 640), (8, 8), (15, 15), (60, 80), (480, 5)])
def test_pictures_of_any_size_are_made_even(shape):
    picture = np.random.default_rng(0).integers(60, 180, shape, np.uint8)

    cleaned, even = in_even_light(picture)

    assert cleaned.shape == even.shape == shape


def test_drops_are_neutral_and_the_ground_is_as_it_was(picture):
    wet = picture.copy()
    wet[100:108, 200:208] = 255

    cleaned = in_even_light(wet)[0]

    assert np.all(cleaned[100:108, 200:208] == EVEN_LEVEL)
    assert np.mean(cleaned[:, :150] == in_even_light(picture)[0][:, :150]) > 0.9


def test_drops_do_not_darken_the_ground_around_them():
    rng = np.random.default_rng(0)
    ground = np.rint(120.0 + rng.normal(0.0, 4.0, (480, 512))).astype(np.uint8)
    wet = ground.copy()
    for v, u in rng.integers(8, (472, 504), (250, 2)):
        wet[v - 5 : v + 5, u - 5 : u + 5] = 240

    cleaned, even = in_even_light(wet)

    beside = cv2.dilate((wet == 240).astype(np.uint8), np.ones((25, 25))).astype(bool) & (cleaned != EVEN_LEVEL)
    dry = even_brightness(ground).astype(float)[beside]
    assert abs(np.mean(cleaned[beside] - dry)) < 0.3 * abs(np.mean(even_brightness(wet)[beside] - dry))
    assert np.all(even[wet == 240] > 200)  # for those who learn what stands still


def test_a_black_picture_shows_nothing():
    assert np.ptp(in_even_light(np.zeros((240, 256), np.uint8))[0]) == 0
