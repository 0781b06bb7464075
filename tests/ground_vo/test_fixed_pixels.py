"""What is fixed to the lens shows in the patches of a path."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from trailmark_ground_vo.fixed_pixels import fixed_pixels


def patches_of_ground(n: int) -> np.ndarray:
    """Patches of other ground each: smooth noise of one standard deviation, 30 levels."""
    rng = np.random.default_rng(7)
    noise = [cv2.GaussianBlur(rng.standard_normal((44, 44)), (0, 0), 1.5) for _ in range(n)]
    return np.clip([128 + 30 * one / one.std() for one in noise], 0, 255).astype(np.uint8)


def test_a_mark_is_fixed_and_ground_is_not():
    patches = patches_of_ground(40)
    patches[:, 20:25, 10:15] = 175

    fixed = fixed_pixels(patches)

    assert fixed[:, 20:25, 10:15].all()
    fixed[:, 18:27, 8:17] = False
    assert fixed.mean() < 1e-3


@pytest.mark.parametrize("n", [60, 150])
def test_what_covers_the_lens_on_half_of_the_way_is_fixed_there_alone(n):
    patches = patches_of_ground(n)
    is_covered = np.arange(n) % 20 < 10
    rng = np.random.default_rng(8)
    cover = patches_of_ground(1)[0]
    patches[is_covered] = np.clip(cover + rng.normal(0, 3, (is_covered.sum(), 44, 44)), 0, 255).astype(np.uint8)

    fixed = fixed_pixels(patches)

    assert fixed[is_covered].all()
    assert fixed[~is_covered].mean() < 0.2  # ground that has the level of the cover by chance


def test_a_few_patches_say_nothing():
    assert not fixed_pixels(np.full((11, 44, 44), 180, np.uint8)).any()
