"""Even light, and nothing where something other than the ground is seen."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.geometry import Pose2
from trailmark_ground_vo.brightness import EVEN_LEVEL, even_brightness
from trailmark_ground_vo.cleaning import clean


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


def test_drops_are_neutral_and_the_ground_is_as_it_was(picture):
    wet = picture.copy()
    wet[100:108, 200:208] = 255

    cleaned = clean(wet)

    assert np.all(cleaned[100:108, 200:208] == EVEN_LEVEL)
    assert np.mean(cleaned[:, :150] == clean(picture)[:, :150]) > 0.9


def test_a_black_picture_shows_nothing():
    assert np.ptp(clean(np.zeros((240, 256), np.uint8))) == 0
