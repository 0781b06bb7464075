"""Light, dirt and covers that are not ours, end to end: right, or lost, never wrong without a word."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from trailmark.estimates import Belief, Lost, Motion
from trailmark.frames import Image
from trailmark.geometry import Twist2
from trailmark.interfaces import Session
from trailmark.testing.ground import ground_run, straight
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.localizer import GroundVO

SPEED_MPS = 0.3


def changed(frame, pixels):
    return replace(frame, payload=Image(np.clip(np.rint(pixels), 0, 255).astype(np.uint8)))


def flicker(index, frame):
    return changed(frame, frame.payload.pixels * math.exp(0.15 * np.random.default_rng(index).standard_normal()))


def low_light(index, frame):
    noise = np.random.default_rng(index).normal(0.0, 5.0, frame.payload.pixels.shape)
    return changed(frame, 0.35 * frame.payload.pixels.astype(float) + noise)


def marks(index, frame):
    """Bright spots on 4 % of the lens."""
    rng, spots = np.random.default_rng(1), np.zeros(frame.payload.pixels.shape, np.float32)
    while spots.mean() < 0.04:
        centre = (int(rng.integers(0, spots.shape[1])), int(rng.integers(0, spots.shape[0])))
        cv2.circle(spots, centre, int(rng.integers(2, 7)), 1.0, -1)
    return changed(frame, frame.payload.pixels * (1 - spots) + 250.0 * spots)


def shadow(index, frame):
    """Half the light beyond an edge that wanders."""
    edge = 160.0 + 100.0 * math.sin(index / 9.0)
    light = 0.75 + 0.25 * np.tanh((np.arange(frame.payload.pixels.shape[1]) - edge) / 4.0)
    return changed(frame, frame.payload.pixels * light[None, :])


@pytest.mark.parametrize("change", [flicker, low_light, marks, shadow])
def test_the_track_is_kept_and_right(change, camera, ground, track):
    run = ground_run(straight(SPEED_MPS), 60, ground=ground, camera=camera)

    tracked = track(run, change=change)

    assert len(tracked.motions) >= 57
    assert math.hypot(*tracked.error()[:2]) < 2.5e-3  # 1 % of 0.25 m
    for motion in tracked.motions:
        error = abs(motion.pose_since_now.x - SPEED_MPS * (motion.stamp_s - motion.since_s))
        assert error < max(5e-4, 5.0 * math.sqrt(np.linalg.inv(motion.information)[0, 0]))


def test_a_lens_that_is_covered_on_the_move_is_lost_when_wheels_go_on(camera, ground):
    run = ground_run(straight(SPEED_MPS), 40, ground=ground, camera=camera)
    localizer = GroundVO(GroundVOConfig(camera="floor", n_pixels=384))
    localizer.start(Session(name="vo", sensors={"floor": run.sensor}))
    cover = 110.0 + 40.0 * cv2.GaussianBlur(np.random.default_rng(3).standard_normal((288, 320)), (0, 0), 3.0) * 6.0
    answers = []

    for index, frame in enumerate(run.frames):
        noise = np.random.default_rng(index).normal(0.0, 3.0, cover.shape)
        seen = changed(frame, cover + noise) if index >= 20 else frame
        belief = Belief(seen.stamp_s, twist=Twist2(SPEED_MPS, 0.0, 0.0), motion_age_s=0.0)
        answers += [(index, estimate) for estimate in localizer.observe(seen, belief)]

    assert all(isinstance(estimate, Motion) for index, estimate in answers if index < 20)
    assert all(isinstance(estimate, Lost) for index, estimate in answers if index >= 20)
    assert "stands still" in answers[-1][1].reason


def test_a_robot_at_rest_is_told_that_it_rests(camera, ground, track):
    run = ground_run(straight(0.0), 40, ground=ground, camera=camera)

    tracked = track(run)

    assert len(tracked.motions) == 39
    assert math.hypot(*tracked.error()[:2]) < 1e-4


def test_after_a_gap_on_the_move_the_track_is_taken_up_again(camera, ground):
    """Others go on telling while the camera gives no picture for 1 s; what they say is compared over the same time."""
    run = ground_run(straight(SPEED_MPS), 160, ground=ground, camera=camera)
    frames = list(run.frames)
    localizer = GroundVO(GroundVOConfig(camera="floor"))
    localizer.start(Session(sensors=run.sensors))
    told = []
    for frame in [*frames[:40], *frames[110:]]:
        belief = Belief(frame.stamp_s, twist=Twist2(SPEED_MPS, 0.0, 0.0), motion_age_s=0.01)
        told.append(localizer.observe(frame, belief))

    after = [estimates[0] for estimates in told[50:]]

    assert all(isinstance(estimate, Motion) for estimate in after)
