"""Texture that two pictures share is ground; light, noise, covers out of focus and what is cut off at white are not."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from trailmark_ground_vo.filters import smooth
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.shared_texture import TextureComparison

SIZE, MOVED, STILL = (320, 288), ImageMotion(12.0, -5.0, 0.02), ImageMotion(0.0, 0.0, 0.0)


def seen(levels, seed: int, noise: float = 3.0) -> np.ndarray:
    """Return a picture of these levels by a camera with noise, smoothed."""
    noisy = levels + np.random.default_rng(seed).normal(0.0, noise, (SIZE[1], SIZE[0]))
    return smooth(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))


def blobs(sigma_px: float, contrast: float, level: float = 120.0) -> np.ndarray:
    """Return a random texture of this grain, larger than a picture by 40 px to all sides."""
    rng = np.random.default_rng(5)
    texture = cv2.GaussianBlur(rng.standard_normal((SIZE[1] + 80, SIZE[0] + 80)), (0, 0), sigma_px)
    return level + contrast * texture / texture.std()


def view(texture: np.ndarray, motion: ImageMotion) -> np.ndarray:
    """Return what is seen of a texture after the content has moved."""
    u, v = np.meshgrid(*(np.arange(n) - (n - 1) / 2 for n in SIZE))
    u, v = u - motion.u, v - motion.v
    cos, sin = np.cos(motion.turn_rad), np.sin(motion.turn_rad)
    from_u, from_v = cos * u - sin * v, sin * u + cos * v
    middle = [(n - 1) / 2 + 40 for n in SIZE]
    return cv2.remap(texture, (from_u + middle[0]).astype(np.float32), (from_v + middle[1]).astype(np.float32), 1)


@pytest.fixture
def comparison() -> TextureComparison:
    return TextureComparison(SIZE, 1.0)


@pytest.mark.parametrize("noise", [1.0, 3.0, 12.0])
def test_ground_is_shared_where_it_moved_to_and_nowhere_else(comparison, noise):
    ground = blobs(1.5, 12.0)
    before, now = seen(view(ground, STILL), 0, noise), seen(view(ground, MOVED), 1, noise)

    assert comparison.compare(before, now, MOVED).is_there
    assert comparison.is_in_focus(before, now, MOVED)
    assert not comparison.compare(before, now, STILL).is_there
    assert not comparison.compare(before, now, ImageMotion(18.0, -5.0, 0.02)).is_there


@pytest.mark.parametrize("level", [20.0, 100.0, 245.0, 300.0])
@pytest.mark.parametrize("noise", [0.3, 3.0, 12.0])
def test_an_even_cover_behind_a_vignette_shares_nothing(comparison, level, noise):
    u, v = np.meshgrid(*(np.linspace(-1, 1, n) for n in SIZE))
    cover = level * (1.0 - 0.2 * (u**2 + v**2))

    shared = comparison.compare(seen(cover, 0, noise), seen(cover, 1, noise), STILL)

    assert not shared.is_there


@pytest.mark.parametrize("noise", [1.0, 3.0, 6.0])
def test_a_cover_out_of_focus_is_told_from_ground(comparison, noise):
    cover = view(blobs(25.0, 20.0), STILL)

    assert not comparison.is_in_focus(seen(cover, 0, noise), seen(cover, 1, noise), STILL)


def test_over_exposed_pictures_share_nothing_but_where_they_are_not(comparison):
    ground = blobs(1.5, 12.0)
    light = np.where(np.arange(SIZE[0]) < 0.15 * SIZE[0], 1.0, 6.0)
    before, now = seen(view(ground, STILL) * light, 0), seen(view(ground, MOVED) * light, 1)

    assert comparison.compare(before, now, MOVED).levels > 0.0
    assert not comparison.compare(before, now, MOVED).is_there  # a rim is too little to go by


def test_what_is_fixed_to_the_lens_is_not_asked(comparison):
    marks = blobs(2.0, 30.0)[:288, :320]
    closed = np.ones((SIZE[1], SIZE[0]), np.bool_)
    assert comparison.compare(seen(marks, 0), seen(marks, 1), STILL).is_there

    comparison.ignore(closed)

    assert comparison.compare(seen(marks, 0), seen(marks, 1), STILL).sigmas == 0.0
