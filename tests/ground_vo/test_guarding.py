"""The plain tracker has its way in even light; the guarded one takes over without a gap, and gives back."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.testing.ground import ground_run, straight
from trailmark_ground_vo.areas import margin_px, max_shift_px
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.guarding import GroundTracker
from trailmark_ground_vo.motion import ImageMotion, pose_prev_now
from trailmark_ground_vo.tracker import RelativeTracker, TrackedMotion, TrackingFailure

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
    assert tracker.counters() == {"suspected": 0, "guarded": 0, "repeated": 0}


@pytest.mark.parametrize("mode", ["whole_pixels", "pyramid"])
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


def test_the_same_picture_bit_by_bit_is_lost_while_others_move(camera, pictures):
    tracker, ten_px = GroundTracker(config(), camera.size), ImageMotion(10.0, 0.0, 0.0)
    follow(tracker, pictures[:20])

    frozen = tracker.step(pictures[19].copy(), 20 / 70, ten_px)

    assert isinstance(frozen, TrackingFailure)
    assert "frozen" in frozen.reason


def test_marks_on_the_lens_are_learned_and_the_track_is_right(camera, pictures):
    for v, u in np.random.default_rng(4).integers(4, 270, (70, 2)):
        for picture in pictures:
            picture[v : v + 8, u : u + 8] = 100  # within the ground's own contrast
    tracker = GroundTracker(config(), camera.size)

    said = follow(tracker, pictures)

    told = [answer for answer in said if isinstance(answer, TrackedMotion)]
    assert len(told) >= 57
    steps = np.array([abs(pose_prev_now(answer.motion, camera.metres_per_pixel).x) for answer in told])
    np.testing.assert_allclose(steps, SPEED_MPS / 70, atol=0.2e-3)


def test_a_lattice_of_marks_leaves_the_track_as_it_is(camera, pictures):
    for v in range(4, camera.size[1] - 8, 24):
        for u in range(4, camera.size[0] - 8, 24):
            for picture in pictures:
                picture[v : v + 8, u : u + 8] = 100
    tracker = GroundTracker(config(), camera.size)

    said = follow(tracker, pictures[:40])

    told = [answer for answer in said if isinstance(answer, TrackedMotion)]
    assert len(told) >= 37
    steps = np.array([abs(pose_prev_now(answer.motion, camera.metres_per_pixel).x) for answer in told])
    np.testing.assert_allclose(steps[20:], SPEED_MPS / 70, atol=0.2e-3)


def test_a_picture_of_another_size_has_a_rim_and_a_reach_of_its_own():
    sizes = [(512, 480), (1024, 960), (320, 240), (160, 120)]

    rims = [(margin_px(config(), size), max_shift_px(config(), size)) for size in sizes]

    assert rims == [(64, 36), (128, 72), (32, 18), (20, 9)]  # the last as wide as the search reaches
    assert max_shift_px(config(), (1024, 960), is_guarded=True) == 336
    assert {margin_px(config(mode="whole_pixels"), size) for size in sizes} == {64}  # as printed


def test_a_lost_picture_names_the_key_that_limits_the_speed(camera, pictures):
    tracker = GroundTracker(config(max_shift_px=10), camera.size)
    tracker.step(pictures[0], 0.0)

    said = tracker.step(np.random.default_rng(0).integers(0, 256, pictures[0].shape, np.uint8), 1 / 70)

    assert isinstance(said, TrackingFailure)
    assert "max_shift_px is 10" in said.reason


@pytest.mark.parametrize("expected", [None, ImageMotion(1.0, 0.0, 0.0)])
def test_a_picture_that_repeats_itself_is_no_picture(camera, pictures, expected):
    tracker, undisturbed = GroundTracker(config(), camera.size), GroundTracker(config(), camera.size)
    follow(tracker, pictures[:10])
    told = follow(undisturbed, pictures[:11])[-1]

    repeated = tracker.step(pictures[9], 1.0, expected)
    after = tracker.step(pictures[10], 1.1)

    assert isinstance(repeated, TrackingFailure)
    assert "bit by bit" in repeated.reason
    assert isinstance(after, TrackedMotion)
    assert after.motion == told.motion
    assert after.since_s == told.since_s  # what the repeated picture did not show is in the next motion


def test_a_picture_that_is_repeated_while_others_stand_is_of_a_robot_that_stands(camera, pictures):
    tracker = GroundTracker(config(), camera.size)
    follow(tracker, pictures[:10])

    said = tracker.step(pictures[9], 1.0, ImageMotion(0.0, 0.0, 0.0))

    assert isinstance(said, TrackedMotion)
    assert 1.0 / math.sqrt(said.information[0, 0]) == pytest.approx(0.5)  # one that creeps is left to the others


@pytest.mark.parametrize("level", [20, 120])
def test_a_picture_of_noise_alone_tells_nothing_from_the_first_one_on(camera, level):
    rng, (width, height) = np.random.default_rng(level), camera.size
    covered = [np.clip(np.rint(rng.normal(level, 1.0, (height, width))), 0, 255).astype(np.uint8) for _ in range(12)]

    said = follow(GroundTracker(config(), camera.size), covered)

    assert not any(isinstance(answer, TrackedMotion) for answer in said)
