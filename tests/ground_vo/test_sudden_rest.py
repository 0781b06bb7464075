"""Content that had moved and was doubted or lost is not known to stand as soon as it seems to."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from trailmark.estimates import Belief, Motion
from trailmark.frames import Image
from trailmark.interfaces import Session
from trailmark.testing.ground import ground_run, straight
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.localizer import GroundVO
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.sudden_rest import SuddenRest

STILL, SLOW, FAST = (ImageMotion(u, 0.0, 0.0) for u in (0.1, 4.0, 20.0))


@pytest.fixture
def watch() -> SuddenRest:
    return SuddenRest()


def test_what_was_never_seen_to_move_may_stand(watch):
    watch.doubt(None, is_at_rest=False)

    assert not watch.is_doubtful(STILL)


def test_after_a_loss_on_the_move_rest_is_doubtful_and_so_is_much_less_motion_but_not_the_same(watch):
    watch.believe(FAST)
    watch.doubt(None, is_at_rest=False)

    assert watch.is_doubtful(STILL)
    assert watch.is_doubtful(SLOW)
    assert not watch.is_doubtful(FAST)


@pytest.mark.parametrize(("rival", "is_doubtful"), [(FAST, True), (STILL, False)])
def test_a_rival_makes_rest_doubtful_where_it_moves(watch, rival, is_doubtful):
    watch.doubt(rival, is_at_rest=False)

    assert watch.is_doubtful(STILL) == is_doubtful


def test_thirty_pictures_of_rest_in_a_row_are_believed(watch):
    watch.doubt(FAST, is_at_rest=False)

    for _ in range(29):
        watch.doubt(None, is_at_rest=True)
    assert watch.is_doubtful(STILL)
    watch.doubt(None, is_at_rest=True)

    assert not watch.is_doubtful(STILL)


def test_another_doubt_begins_the_count_again(watch):
    watch.doubt(FAST, is_at_rest=False)
    for _ in range(29):
        watch.doubt(None, is_at_rest=True)

    watch.doubt(None, is_at_rest=False)
    watch.doubt(None, is_at_rest=True)

    assert watch.is_doubtful(STILL)


def test_a_stop_that_is_followed_is_believed(watch):
    for motion in (FAST, SLOW, STILL):
        assert not watch.is_doubtful(motion)
        watch.believe(motion)


@pytest.mark.parametrize("sigma_px", [3.0, 8.0])
def test_smears_on_the_lens_before_plain_ground_are_never_taken_for_rest(camera, ground, sigma_px):
    """Smears on a tenth of the lens take half of the light, and have more contrast than the ground."""
    run = ground_run(straight(0.4), 90, ground=ground, camera=camera)
    noise = cv2.GaussianBlur(np.random.default_rng(3).standard_normal((288, 320)), (0, 0), sigma_px)
    smears = 0.5 / (1.0 + np.exp(-6.0 * (noise / noise.std() - 1.3)))
    localizer = GroundVO(GroundVOConfig(camera="floor"))
    localizer.start(Session(sensors=run.sensors))

    n_wrong = 0
    for index, frame in enumerate(run.frames):
        light = 190.0 + 0.25 * (frame.payload.pixels.astype(float) - 128.0)
        seen = light * (1.0 - smears) + np.random.default_rng(index).normal(0.0, 2.0, light.shape)
        pixels = np.clip(np.rint(seen), 0, 255).astype(np.uint8)
        for estimate in localizer.observe(replace(frame, payload=Image(pixels)), Belief(frame.stamp_s)):
            if isinstance(estimate, Motion) and index > 1:  # of two pictures alone nobody can tell
                error = abs(estimate.pose_since_now.x - 0.4 * (estimate.stamp_s - estimate.since_s))
                n_wrong += error > max(5e-4, 5.0 * math.sqrt(np.linalg.inv(estimate.information)[0, 0]))

    assert n_wrong == 0
