"""The plain tracker has its way in even light; the guarded one takes over without a gap, and gives back."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.testing.ground import ground_run, straight
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.guarding import GroundTracker
from trailmark_ground_vo.motion import pose_prev_now
from trailmark_ground_vo.tracker import RelativeTracker, TrackedMotion

SPEED_MPS = 0.26


@pytest.fixture
def pictures(camera, ground):
    run = ground_run(straight(SPEED_MPS), 60, ground=ground, camera=camera)
    return [np.array(frame.payload.pixels) for frame in run.frames]


def follow(tracker, pictures) -> list:
    return [tracker.step(picture, index / 70) for index, picture in enumerate(pictures)]


def config(**keys) -> GroundVOConfig:
    return GroundVOConfig(camera="floor", n_pixels=384, smooth_search=True, **keys)


def flickering(pictures, bright, dark) -> list:
    """Return pictures that are bright and dark by turns."""
    gains = [bright if n % 2 else dark for n in range(len(pictures))]
    return [np.clip(gain * picture, 0, 255).astype(np.uint8) for gain, picture in zip(gains, pictures)]


def moves(said) -> np.ndarray:
    return np.array([answer.motion.array() for answer in said if isinstance(answer, TrackedMotion)])


def test_in_even_light_the_plain_tracker_has_its_way(camera, pictures):
    tracker = GroundTracker(config(), camera.size)

    said, alone = follow(tracker, pictures), follow(RelativeTracker(config(), camera.size), pictures)

    np.testing.assert_array_equal(moves(said), moves(alone))
    assert tracker.counters() == {"suspected": 0, "guarded": 0}


@pytest.mark.parametrize("mode", ["paper", "pyramid"])
def test_the_other_modes_are_not_guarded(camera, pictures, mode):
    tracker, alone = GroundTracker(config(mode=mode), camera.size), RelativeTracker(config(mode=mode), camera.size)
    flickering = [
        np.clip((1.3 if n % 2 else 0.8) * picture, 0, 255).astype(np.uint8) for n, picture in enumerate(pictures)
    ]

    said = [follow(which, flickering[:10]) for which in (tracker, alone)]

    assert [type(answer) for answer in said[0]] == [type(answer) for answer in said[1]]
    np.testing.assert_array_equal(moves(said[0]), moves(said[1]))


def test_light_that_flickers_for_a_while_leaves_no_gap(camera, pictures):
    pictures[20:25] = flickering(pictures[20:25], 1.4, 0.7)
    tracker = GroundTracker(config(), camera.size)

    said = follow(tracker, pictures)

    assert all(isinstance(answer, TrackedMotion) for answer in said[1:])
    assert [round(70 * answer.since_s) for answer in said[1:]] == list(range(59))
    steps = np.array([pose_prev_now(answer.motion, camera.metres_per_pixel).x for answer in said[1:]])
    np.testing.assert_allclose(np.abs(steps), SPEED_MPS / 70, atol=0.05e-3)
    assert tracker.counters()["suspected"] == 1
    assert 5 <= tracker.counters()["guarded"] < 45


def test_suspicion_lasts_longer_when_it_comes_back(camera, pictures):
    for n in (5, 40):
        pictures[n] = np.clip(1.4 * pictures[n], 0, 255).astype(np.uint8)
    tracker = GroundTracker(config(), camera.size)

    follow(tracker, pictures)

    assert tracker.counters()["suspected"] == 2
    assert tracker.counters()["guarded"] > 30 + 15  # not given back a second time within the drive


def test_what_is_told_while_guarded_knows_its_scatter(camera, pictures):
    pictures[20:] = [
        np.clip((1.2 if n % 2 else 0.9) * picture, 0, 255).astype(np.uint8) for n, picture in enumerate(pictures[20:])
    ]
    tracker = GroundTracker(config(), camera.size)

    said = follow(tracker, pictures)

    sigma = [math.sqrt(np.linalg.inv(answer.information)[0, 0]) for answer in said[1:]]
    errors = np.abs(np.abs(moves(said)[:, 0]) - SPEED_MPS / 70 / camera.metres_per_pixel[0])
    assert np.mean(errors[20:] < 5 * np.array(sigma[20:])) > 0.99
