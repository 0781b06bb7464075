"""What moves beneath a content that stands still is ground under a film; noise, light and slow ground are not."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import pytest

from trailmark.frames import Image
from trailmark.testing.ground import MirroredFloor, ground_run, straight
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.moving_layer import LayerWatch

SIZE, STILL = (320, 240), ImageMotion(0.0, 0.0, 0.0)


def texture(seed: int, sigma_px: float, contrast: float) -> np.ndarray:
    blobs = cv2.GaussianBlur(np.random.default_rng(seed).standard_normal((240, 420)), (0, 0), sigma_px)
    return contrast * blobs / blobs.std()


@pytest.fixture(scope="module")
def ground() -> np.ndarray:
    return texture(1, 1.5, 5.0)


@pytest.fixture(scope="module")
def film() -> np.ndarray:
    return texture(2, 1.2, 15.0)[:, :320]


@pytest.fixture
def watch() -> LayerWatch:
    return LayerWatch(SIZE)


def seen(ground, u: float, film, seed: int, light=1.0) -> np.ndarray:
    """Return a picture of the ground, u to the right, through a film."""
    moved = cv2.warpAffine(ground, np.array([[1.0, 0.0, u - 50.0], [0.0, 1.0, 0.0]]), SIZE, flags=cv2.INTER_CUBIC)
    noise = np.random.default_rng(seed).normal(0.0, 3.0, moved.shape)
    return np.clip(np.rint(light * (120.0 + moved + film) + noise), 0, 255).astype(np.uint8)


def findings(watch, pictures, motion=STILL) -> list[bool]:
    return [watch.is_moving(before, now, motion) for before, now in pairwise(pictures)]


@pytest.mark.parametrize("step_px", [4.0, 12.0])
def test_ground_that_moves_beneath_a_film_is_found_at_once(watch, ground, film, step_px):
    assert all(findings(watch, [seen(ground, step_px * n, film, n) for n in range(4)]))


def test_ground_that_crawls_beneath_a_film_is_found_in_a_few_pictures(watch, ground, film):
    assert any(findings(watch, [seen(ground, 0.8 * n, film, n) for n in range(9)]))


def test_at_rest_nothing_moves_whatever_the_light(watch, ground, film):
    rows = np.linspace(0.0, 1.0, SIZE[1])[:, None]
    pictures = [seen(ground, 0.0, film, n, 1.0 + 0.2 * np.sin(2.0 * np.pi * (rows + 0.3 * n))) for n in range(12)]

    assert not any(findings(watch, pictures))


def test_ground_that_moves_as_was_found_is_not_beneath_anything(watch, ground):
    pictures = [seen(ground, 0.25 * n, 0.0, n) for n in range(12)]

    assert not any(findings(watch, pictures, ImageMotion(0.25, 0.0, 0.0)))


def test_after_a_finding_a_content_is_doubtful_for_some_pictures(watch, ground, film):
    findings(watch, [seen(ground, 6.0 * n, film, n) for n in range(2)])
    assert watch.is_doubtful

    findings(watch, [seen(ground, 6.0, film, n) for n in range(1, 20)])
    assert not watch.is_doubtful


@pytest.mark.parametrize("kept", [0.2, 0.4])
def test_a_film_from_the_first_picture_on_does_not_hold_a_robot_that_drives(kept, film, camera, track):
    floor = MirroredFloor.procedural(seed=11, size_px=512, grain_px=1.5)
    shape = camera.size[::-1]
    stuck = cv2.copyMakeBorder(film, 0, shape[0] - 240, 0, 0, cv2.BORDER_REFLECT)

    def through(index, frame):
        pixels = frame.payload.pixels
        noisy = 120.0 + kept * (pixels - 120.0) + stuck + np.random.default_rng(index).normal(0.0, 2.0, shape)
        return frame.__class__(frame.sensor, frame.stamp_s, Image(np.clip(np.rint(noisy), 0, 255).astype(np.uint8)))

    tracked = track(ground_run(straight(0.3), 25, ground=floor, camera=camera), change=through)

    assert not tracked.motions
    assert any("beneath" in lost.reason for lost in tracked.lost)
