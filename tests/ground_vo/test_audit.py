"""The audit finds nothing in right motions on even ground, and finds what each condition changes."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from trailmark.geometry import Pose2
from trailmark_ground_vo.audit import _PART_SIGMAS, MotionAudit
from trailmark_ground_vo.filters import noise_level, smooth
from trailmark_ground_vo.motion import ImageMotion

STEP = Pose2(0.004, 0.0, 0.01)


@pytest.fixture
def pictures(camera, ground):
    """Two pictures, and how the content moved from one to the other."""
    before, now = (camera.image(ground, pose, seed) for seed, pose in enumerate((Pose2(), STEP)))
    content = (camera.mounting.planar().inverse() @ STEP @ camera.mounting.planar()).inverse()
    scale = camera.metres_per_pixel
    return before, now, ImageMotion(content.x / scale[0], -content.y / scale[1], content.theta)


def reason(before, now, motion) -> str:
    height, width = before.shape
    audit = MotionAudit((width, height), 1.0).audit(smooth(before), smooth(now), motion)
    return audit.reason_suspected(noise_level(now))


def part_sigmas(before, now, motion) -> float:
    height, width = before.shape
    return MotionAudit((width, height), 1.0).audit(smooth(before), smooth(now), motion).part_sigmas


def test_the_right_motion_is_beyond_suspicion(pictures):
    assert reason(*pictures) == ""


@pytest.mark.parametrize("vignette", [0.12, 0.35])
def test_a_lens_that_darkens_is_beyond_suspicion(camera, ground, pictures, vignette):
    dim = replace(camera, vignette=vignette)

    assert reason(dim.image(ground, Pose2(), 0), dim.image(ground, STEP, 1), pictures[2]) == ""


@pytest.mark.parametrize("off", [(0.5, 0.0, 0.0), (0.0, -0.5, 0.0), (0.0, 0.0, math.radians(0.15)), (8.0, 0.0, 0.0)])
def test_a_wrong_motion_is_suspected(pictures, off):
    before, now, motion = pictures

    assert reason(before, now, ImageMotion(motion.u + off[0], motion.v + off[1], motion.turn_rad + off[2]))


def test_content_that_stands_still_is_suspected_where_the_rest_moves(pictures):
    before, now, motion = pictures
    spots = np.random.default_rng(0).integers(10, 270, (60, 2))
    for v, u in spots:
        before[v : v + 6, u : u + 6] = now[v : v + 6, u : u + 6] = 250

    assert "pixels differ" in reason(before, now, motion)
    assert reason(before, now, ImageMotion(0.0, 0.0, 0.0))


@pytest.mark.parametrize("gain", [0.85, 1.15])
def test_light_that_flickers_is_suspected(pictures, gain):
    before, now, motion = pictures

    assert reason(before, np.clip(gain * now, 0, 255).astype(np.uint8), motion)


def test_a_shadow_on_a_corner_is_suspected(pictures):
    before, now, motion = pictures
    now[:90, :90] //= 2

    assert reason(before, now, motion)


def test_a_part_that_moves_otherwise_is_suspected(camera, ground, pictures):
    before, now, motion = pictures
    now[:80, :] = camera.image(ground, STEP @ Pose2(0.0004, 0.0, 0.0), 1)[:80, :]  # one pixel farther

    assert reason(before, now, motion)


def zoomed(image, by: float):
    """Return a picture as a camera that is lower by a share sees it."""
    height, width = image.shape
    grown = cv2.getRotationMatrix2D(((width - 1) / 2.0, (height - 1) / 2.0), 0.0, 1.0 + by)
    return cv2.warpAffine(image, grown, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)


@pytest.mark.parametrize("by", [-0.003, 0.003])
@pytest.mark.parametrize("seen", [(slice(None), slice(None)), (slice(None), slice(140, None)), (slice(90, None),) * 2])
def test_no_part_moves_otherwise_where_the_camera_heaves(pictures, by, seen):
    """Nor where only a half or a corner of the picture has anything in it."""
    before, now, motion = pictures
    now, empty = zoomed(now, by), np.full_like(now, 120)
    pair = [np.array(empty) for _ in range(2)]
    for picture, image in zip(pair, (before, now)):
        picture[seen] = image[seen]

    assert part_sigmas(*pair, motion) < _PART_SIGMAS


@pytest.mark.parametrize("by", [-0.003, -0.001, 0.0, 0.001, 0.003])
def test_a_part_that_moves_otherwise_is_told_where_the_camera_heaves(pictures, by):
    before, now, motion = pictures
    now = zoomed(now, by)
    now[-70:, -70:] = np.roll(now, 2, axis=0)[-70:, -70:]

    assert part_sigmas(before, now, motion) > _PART_SIGMAS


@pytest.mark.parametrize("by", [-0.02, 0.02])
def test_a_picture_that_grows_more_than_a_camera_heaves_is_suspected(pictures, by):
    before, now, motion = pictures

    assert reason(before, zoomed(now, by), motion)


def test_noise_that_could_turn_the_picture_is_suspected(camera, pictures):
    plain = np.full_like(pictures[0], 120)
    rng = np.random.default_rng(3)
    before, now = (np.clip(plain + rng.normal(0, 3, plain.shape), 0, 255).astype(np.uint8) for _ in range(2))

    assert "noise turns it" in reason(before, now, ImageMotion(0.0, 0.0, 0.0))


def test_a_motion_that_leaves_nothing_in_view_is_suspected(pictures):
    before, now, _ = pictures

    assert reason(before, now, ImageMotion(1e4, 0.0, 0.0))


def test_smoothed_pictures_of_equal_ground_spread_as_the_noise_does(pictures):
    before, now, motion = pictures

    audit = MotionAudit((320, 288), 1.0).audit(smooth(before), smooth(now), motion)

    assert audit.spread == pytest.approx(0.39 * noise_level(now), rel=0.25)


def test_a_picture_of_marks_alone_explains_no_motion(pictures):
    before, now, motion = pictures
    height, width = before.shape
    audit = MotionAudit((width, height), 1.0)
    assert audit.spread(smooth(before), smooth(now), motion) < math.inf

    audit.ignore(np.ones((height, width), bool))

    assert audit.spread(smooth(before), smooth(now), motion) == math.inf
