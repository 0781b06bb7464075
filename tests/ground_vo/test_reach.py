"""What is said when the ground moved farther than a search reaches, and when the camera is noisy."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from trailmark.estimates import Belief, Lost, Motion
from trailmark.frames import Frame, Image
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.testing.ground import MirroredFloor, ground_run, straight
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.localizer import GroundVO


@pytest.fixture(scope="module")
def grain() -> MirroredFloor:
    """Streaks along x, as wood has them: such ground nearly fits to itself farther along."""
    rough = np.random.default_rng(14).normal(size=(1024, 1024)).astype(np.float32)
    streaks = cv2.GaussianBlur(rough, (0, 0), sigmaX=16.0, sigmaY=3.0)
    return MirroredFloor(np.clip(128.0 + 10.0 / streaks.std() * streaks, 0, 255).astype(np.float32))


def started(camera, **keys) -> GroundVO:
    localizer = GroundVO(GroundVOConfig(camera="floor", n_pixels=384, **keys))
    localizer.start(Session(name="vo", sensors={"floor": camera.sensor_info("floor")}))
    return localizer


def jumps(camera, ground, **keys) -> list:
    """Answers to jumps of 25 to 50 mm along x, beyond the reach of 17 mm, one localizer each."""
    rng, answers = np.random.default_rng(8), []
    for seed in range(8):
        there = Pose2(float(rng.uniform(0.025, 0.05) * rng.choice([-1, 1])), 0.0, 0.0)
        localizer = started(camera, **keys)
        for index, pose in enumerate((Pose2(), there)):
            pixels = camera.image(ground, pose, 10 * seed + index)
            said = localizer.observe(Frame("floor", float(index), Image(pixels)), Belief(float(index)))
        answers.append(said[0])
    return answers


def test_ground_that_jumped_out_of_reach_is_lost(camera, grain):
    answers = jumps(replace(camera, vignette=0.2), grain, smooth_search=True, wide_search=False)

    assert all(isinstance(answer, Lost) for answer in answers)


def test_without_asking_for_the_noise_some_jumps_are_believed(camera, grain):
    answers = jumps(
        replace(camera, vignette=0.2),
        grain,
        smooth_search=True,
        max_error_share=1.0,
        learn_flat_field=True,
        wide_search=False,
    )

    assert any(isinstance(answer, Motion) for answer in answers)


def test_a_noisy_camera_keeps_its_track(camera, track):
    dull = MirroredFloor.procedural(seed=15, size_px=1024, grain_px=3.0, contrast=8.0)
    noisy = replace(camera, noise_sigma=12.0, vignette=0.2)
    run = ground_run(straight(0.26), 40, ground=dull, camera=noisy)

    tracked = track(run)

    assert not tracked.lost
    assert math.hypot(*tracked.error()[:2]) < 0.5e-3
