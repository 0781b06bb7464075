"""What does not move with the ground is found: weak or strong, with the motion known or not; ground is not."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from trailmark.testing.ground import ground_run, straight
from trailmark_ground_vo.filters import levels_of, smooth
from trailmark_ground_vo.lens_marks import LensMarkEvidence
from trailmark_ground_vo.motion import ImageMotion

#: Content moves by this per picture along u.
STEP_PX = -6.0
SIGMA = 0.39 * 3.0


@pytest.fixture
def pictures(camera, ground):
    speed = abs(STEP_PX) * camera.metres_per_pixel[0] * 70
    run = ground_run(straight(speed), 24, ground=ground, camera=camera)
    return [np.array(frame.payload.pixels) for frame in run.frames]


def marked(pictures, contrast) -> tuple[list, np.ndarray]:
    """Return pictures with marks of 8 px, and where they are."""
    where = np.zeros(pictures[0].shape, bool)
    for v, u in np.random.default_rng(2).integers(8, 270, (40, 2)):
        where[v : v + 8, u : u + 8] = True
    return [np.where(where, np.uint8(128 + contrast), picture) for picture in pictures], where


def weights_of(pictures, motion) -> np.ndarray | None:
    height, width = pictures[0].shape
    marks, weights = LensMarkEvidence((width, height), 1.0), None
    even = [levels_of(smooth(picture)) for picture in pictures]
    for before, now in itertools.pairwise(even):
        marks.add(before, now, motion, SIGMA)
        news = marks.new_weights()
        weights = weights if news is None else news
    return weights


def content_motion(camera) -> ImageMotion:
    return ImageMotion(-STEP_PX if abs(camera.mounting.yaw) > 3 else STEP_PX, 0.0, 0.0)


@pytest.mark.parametrize("contrast", [100, -60, 40])
@pytest.mark.parametrize("is_known", [True, False])
def test_marks_are_found(camera, pictures, contrast, is_known):
    spoilt, where = marked(pictures, contrast)

    weights = weights_of(spoilt, content_motion(camera) if is_known else None)

    assert weights is not None
    assert np.mean(weights[where] < 128) > 0.9
    assert np.mean(weights[~where] < 128) < 0.12  # rims of the marks


def test_the_veil_of_a_reflection_is_a_mark_through_which_the_ground_shines(camera, pictures):
    v, u = np.mgrid[: pictures[0].shape[0], : pictures[0].shape[1]]
    squared = (u - 150.0) ** 2 + (v - 140.0) ** 2
    light = 250.0 * np.exp(-squared / (2.0 * 8.0**2)) + 60.0 * np.exp(-squared / (2.0 * 24.0**2))
    spoilt = [np.minimum(90.0 + 0.3 * picture + light, 255.0).astype(np.uint8) for picture in pictures]

    weights = weights_of(spoilt, content_motion(camera))

    assert weights is not None
    is_slope = (squared > 10.0**2) & (squared < 25.0**2) & (np.abs(u - 150.0) > np.abs(v - 140.0))
    assert np.mean(weights[is_slope] < 128) > 0.5
    assert np.mean(weights[squared > 80.0**2] < 255) < 0.01


def test_ground_that_moves_is_no_mark(camera, pictures):
    weights = weights_of(pictures, content_motion(camera))

    assert weights is None or np.mean(weights < 255) < 0.01


def test_streaks_along_the_drive_are_no_marks(camera):
    lines = np.clip(np.random.default_rng(0).normal(128.0, 25.0, (288, 1)), 0, 255)
    pictures = [np.tile(lines, (1, 320)).astype(np.uint8)] * 20

    assert weights_of(pictures, content_motion(camera)) is None  # they fit to the motion as well


def test_a_picture_that_stands_still_all_over_is_not_masked(camera, pictures):
    assert weights_of([pictures[0]] * 20, None) is None


def test_a_mark_that_is_wiped_off_is_forgotten(camera, pictures):
    spoilt, where = marked(pictures, 100)

    weights = weights_of([*spoilt[:8], *(pictures * 4)], content_motion(camera))

    assert weights is None or np.mean(weights[where] < 128) < 0.1


def test_at_rest_nothing_is_learned(camera, pictures):
    spoilt, _ = marked(pictures, 100)

    assert weights_of([spoilt[0]] * 20, ImageMotion(0.1, 0.0, 0.0)) is None
