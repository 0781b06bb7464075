"""Where there is more noise than texture, a picture is filtered so that the ground is found in it."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from trailmark.testing.ground import MirroredFloor, ground_run, straight
from trailmark_ground_vo.cleaning import in_even_light
from trailmark_ground_vo.filters import noise_level, smooth
from trailmark_ground_vo.refined_moves import _COARSE, _FINE, _dim_filter


def floor(grain_px: float, contrast: float) -> MirroredFloor:
    """Return a floor with blobs of one size."""
    blobs = cv2.GaussianBlur(np.random.default_rng(3).standard_normal((512, 512)), (0, 0), grain_px)
    return MirroredFloor(np.asarray(60.0 + contrast * blobs / blobs.std(), np.float32))


@pytest.mark.parametrize(
    ("grain_px", "contrast", "wanted"), [(1.5, 12.0, None), (1.5, 2.0, _FINE), (5.0, 0.9, _COARSE)]
)
def test_coarse_ground_in_much_noise_is_filtered_most(grain_px, contrast, wanted):
    texture = floor(grain_px, contrast).texture
    noisy = texture + np.random.default_rng(1).normal(0.0, 6.0, texture.shape)
    cleaned = in_even_light(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))[0]

    assert _dim_filter(smooth(cleaned), noise_level(cleaned)) == wanted


def test_coarse_ground_in_little_light_is_followed(camera, track):
    run = ground_run(straight(0.26), 40, ground=floor(4.0, 3.2), camera=camera)

    def dim(index, frame):
        noise = np.random.default_rng(index).normal(0.0, 6.0, frame.payload.pixels.shape)
        seen = np.clip(np.rint(0.35 * frame.payload.pixels + 20.0 + noise), 0, 255)
        return frame.__class__(frame.sensor, frame.stamp_s, frame.payload.__class__(seen.astype(np.uint8)))

    tracked = track(run, change=dim)

    assert len(tracked.motions) >= 30
    for motion in tracked.motions:
        sigma_m = math.sqrt(float(np.linalg.inv(motion.information)[0, 0]))
        error_m = abs(motion.pose_since_now.x - 0.26 * (motion.stamp_s - motion.since_s))
        assert error_m < max(5.0 * sigma_m, 5e-4)
