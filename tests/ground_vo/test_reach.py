"""What is said when the ground moved farther than a search reaches, and when the camera is noisy."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from trailmark.geometry import Pose2
from trailmark.testing.ground import MirroredFloor, ground_run, straight
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.filters import GAIN_ONE, flatten
from trailmark_ground_vo.guarding import GroundTracker
from trailmark_ground_vo.motion import pose_prev_now
from trailmark_ground_vo.tracker import RelativeTracker, TrackedMotion, TrackingFailure


@pytest.fixture(scope="module")
def grain() -> MirroredFloor:
    """Streaks along x, as wood has them: such ground nearly fits to itself farther along."""
    rough = np.random.default_rng(14).normal(size=(1024, 1024)).astype(np.float32)
    streaks = cv2.GaussianBlur(rough, (0, 0), sigmaX=16.0, sigmaY=3.0)
    return MirroredFloor(np.clip(128.0 + 10.0 / streaks.std() * streaks, 0, 255).astype(np.float32))


def trackers(camera, **keys) -> tuple[GroundTracker, RelativeTracker]:
    """Return both, and the plain one alone."""
    config = GroundVOConfig(camera="floor", n_pixels=384, **keys)
    return GroundTracker(config, camera.size), RelativeTracker(config, camera.size)


def jumps(camera, ground, **keys) -> list[tuple]:
    """True shifts along x of 25 to 50 mm, beyond the reach of 17 mm, and what both and the plain tracker say."""
    rng, answers = np.random.default_rng(8), []
    for seed in range(8):
        there = Pose2(float(rng.uniform(0.025, 0.05) * rng.choice([-1, 1])), 0.0, 0.0)
        both, plain = trackers(camera, **keys)
        for index, pose in enumerate((Pose2(), there)):
            pixels = flatten(camera.image(ground, pose, 10 * seed + index), gain_of(camera))
            said = both.step(pixels, float(index)), plain.step(pixels, float(index))
        answers.append((there.x, *said))
    return answers


def gain_of(camera) -> np.ndarray:
    return np.rint(GAIN_ONE / camera.flat_field).astype(np.uint16)


def test_ground_that_jumped_out_of_reach_is_lost_to_the_search(camera, grain):
    answers = [plain for *_, plain in jumps(replace(camera, vignette=0.2), grain, smooth_search=True)]

    assert all(isinstance(answer, TrackingFailure) for answer in answers)
    assert all("no match" in answer.reason for answer in answers)


def test_ground_that_jumped_out_of_reach_is_found_by_the_second_opinion_or_lost(camera, grain):
    found = [
        (true_m, pose_prev_now(both.motion, camera.metres_per_pixel))
        for true_m, both, _ in jumps(replace(camera, vignette=0.2), grain, smooth_search=True)
        if isinstance(both, TrackedMotion)
    ]

    assert len(found) >= 6
    assert all(math.hypot(-pose.x - true_m, pose.y) < 0.5e-3 for true_m, pose in found)


def test_without_asking_for_the_noise_some_jumps_are_believed(camera, grain):
    answers = jumps(replace(camera, vignette=0.2), grain, smooth_search=True, max_error_share=1.0)

    assert any(isinstance(plain, TrackedMotion) for *_, plain in answers)


def test_a_noisy_camera_keeps_its_track(camera, track):
    dull = MirroredFloor.procedural(seed=15, size_px=1024, grain_px=3.0, contrast=8.0)
    noisy = replace(camera, noise_sigma=12.0, vignette=0.2)
    run = ground_run(straight(0.26), 40, ground=dull, camera=noisy)

    tracked, unsmoothed = track(run), track(run, smooth_search=False)

    assert not tracked.lost
    assert math.hypot(*tracked.error()[:2]) < 0.5e-3
    assert len(unsmoothed.lost) > 20 or math.hypot(*unsmoothed.error()[:2]) < 0.5e-3


def test_the_plain_tracker_needs_smooth_pictures_in_noise(camera):
    dull = MirroredFloor.procedural(seed=15, size_px=1024, grain_px=3.0, contrast=8.0)
    noisy = replace(camera, noise_sigma=12.0, vignette=0.2)
    said = {}
    for is_smooth in (False, True):
        tracker = trackers(noisy, smooth_search=is_smooth)[1]
        pictures = ground_run(straight(0.26), 40, ground=dull, camera=noisy).frames
        said[is_smooth] = [
            tracker.step(flatten(np.array(frame.payload.pixels), gain_of(noisy)), frame.stamp_s) for frame in pictures
        ]

    assert sum(isinstance(answer, TrackingFailure) for answer in said[False]) > 20
    assert not any(isinstance(answer, TrackingFailure) for answer in said[True])
