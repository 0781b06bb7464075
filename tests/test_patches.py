"""Small pictures, normalised by patches."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.patches import SMALL_PX, patch_scores, peak, small_picture


def scene(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.kron(rng.integers(20, 200, (12, 40)), np.ones((20, 20))).astype(np.uint8)


def test_a_small_picture_has_the_size_and_range_that_are_promised() -> None:
    small = small_picture(scene())

    assert small.shape == SMALL_PX[::-1]
    assert np.abs(small).max() <= 1.0


def test_light_that_changes_slowly_over_the_picture_does_not_matter() -> None:
    picture = scene()
    light = np.linspace(0.5, 1.0, picture.shape[1])

    before, after = small_picture(picture), small_picture((picture * light).astype(np.uint8))

    assert np.corrcoef(before.ravel(), after.ravel())[0, 1] > 0.95


@pytest.mark.parametrize("shift_px", [-9, 0, 14])
def test_the_peak_is_at_the_shift(shift_px: int) -> None:
    picture = scene()
    step = picture.shape[1] // SMALL_PX[0] + 1

    seen = np.roll(picture, shift_px * step, axis=1)
    found, score = peak(patch_scores(small_picture(picture), small_picture(seen)))

    assert found == pytest.approx(shift_px * step * SMALL_PX[0] / picture.shape[1], abs=0.5)
    assert score > 0.5
