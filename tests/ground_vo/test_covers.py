"""A cover on the lens shows in two or three patches of a path."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from trailmark_ground_vo.covers import covered_pixels

#: 0.05 m apart, with as much missed as a robot misses [half-size px].
PLACES_PX = np.column_stack([64.0 * np.arange(12) + np.tile([0.0, 4.0, 8.0], 4), np.zeros(12)])


def ground(height, width, seed):
    noise = cv2.GaussianBlur(np.random.default_rng(seed).standard_normal((height, width)), (0, 0), 1.5)
    return np.clip(128 + 30 * noise / noise.std(), 0, 255).astype(np.uint8)


def patches_of_ground():
    """Twelve patches of other ground each."""
    return np.stack([ground(44, 44, seed) for seed in range(12)])


def noisy(picture, seed):
    return np.clip(picture + np.random.default_rng(seed).normal(0.0, 10.0, picture.shape), 0, 255).astype(np.uint8)


def test_ground_is_not_covered():
    assert not covered_pixels(patches_of_ground(), PLACES_PX).any()


def test_a_cover_on_two_patches_is_seen_and_the_others_are_kept():
    patches, cover = patches_of_ground(), ground(44, 44, 99)
    patches[4], patches[5] = noisy(cover, 1), noisy(cover, 2)

    covered = covered_pixels(patches, PLACES_PX)

    assert covered[4:6].all()
    assert covered[4:6].sum() == covered.sum()


def test_a_cover_on_a_quarter_of_three_patches_is_seen_there():
    patches, cover = patches_of_ground(), ground(44, 44, 99)
    for n in (4, 5, 6):
        patches[n, :22, 22:] = noisy(cover, n)[:22, 22:]

    covered = covered_pixels(patches, PLACES_PX)

    assert covered[4:7, :22, 22:].all()
    assert covered.sum() == 3 * 22 * 22


@pytest.mark.parametrize("missed_px", [4, 0])
def test_a_floor_that_repeats_is_kept_unless_the_patches_lie_as_it_repeats(missed_px):
    tile, missed = ground(44, 64, 5), missed_px * np.random.default_rng(1).uniform(-1.0, 1.0, 12)
    patches = [noisy(np.roll(tile, -round(missed[n]), axis=1)[:, :44], n) for n in range(12)]
    places_px = np.column_stack([64.0 * np.arange(12) + missed, np.zeros(12)])

    covered = covered_pixels(np.stack(patches), places_px)

    assert covered.all() if missed_px == 0 else covered.mean() < 0.1


def test_patches_of_the_same_ground_are_not_taken_for_a_cover():
    same = np.stack([noisy(ground(44, 44, 5), n) for n in range(12)])

    assert not covered_pixels(same, np.zeros((12, 2))).any()


def test_parts_that_are_too_small_or_show_nothing_are_not_asked():
    small = np.stack([ground(12, 12, 5)] * 12)

    assert not covered_pixels(small, PLACES_PX).any()
    assert not covered_pixels(np.full((12, 44, 44), 128, np.uint8), PLACES_PX).any()
