"""Pictures whose lines are of two instants are read as one of them; others, and their noise, are left alone."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from trailmark.frames import Image
from trailmark.geometry import Pose2
from trailmark.testing.ground import ground_run
from trailmark_ground_vo.interlace import FieldReader, is_combed


def floor_at(u: int, grain_px: float = 1.5, noise: float = 3.0) -> np.ndarray:
    blobs = cv2.GaussianBlur(np.random.default_rng(1).standard_normal((240, 400)), (0, 0), grain_px)
    pixels = 120.0 + 15.0 * blobs / blobs.std() + np.random.default_rng(u).normal(0.0, noise, (240, 400))
    return np.clip(np.rint(pixels), 0, 255).astype(np.uint8)[:, 40 - u : 360 - u].copy()


def woven(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    both = first.copy()
    both[1::2] = second[1::2]
    return both


@pytest.mark.parametrize("noise", [0.0, 3.0, 30.0])
@pytest.mark.parametrize("grain_px", [0.6, 1.5, 6.0])
def test_a_picture_of_one_instant_is_not_combed(grain_px, noise):
    assert not is_combed(floor_at(0, grain_px, noise))


def test_a_picture_of_two_instants_is_combed_where_the_content_moved():
    assert is_combed(woven(floor_at(0), floor_at(6)))
    assert not is_combed(woven(floor_at(0), floor_at(0)))


def test_small_and_blank_pictures_are_not_combed():
    assert not is_combed(np.zeros((3, 8), np.uint8))
    assert not is_combed(np.full((240, 320), 255, np.uint8))


@pytest.mark.parametrize("n_rows", [240, 239])
def test_a_combed_picture_is_read_as_its_even_lines(n_rows):
    first, second = floor_at(0)[:n_rows], floor_at(6)[:n_rows]

    read = FieldReader().read(woven(first, second))

    np.testing.assert_array_equal(read[::2], first[::2])
    between = (first[0:-2:2].astype(float) + first[2::2]) / 2.0
    np.testing.assert_allclose(read[1 : 2 * len(between) : 2], between, atol=0.5)


def test_a_camera_that_interlaces_is_known_at_rest_as_well():
    reader, moving, still = FieldReader(), woven(floor_at(0), floor_at(6)), woven(floor_at(0), floor_at(0))
    assert reader.read(still.copy()).tobytes() == still.tobytes()

    for _ in range(3):
        reader.read(moving.copy())

    assert reader.is_interlaced
    assert reader.read(still.copy()).tobytes() != still.tobytes()


def test_stray_combed_pictures_far_apart_are_no_interlaced_video():
    reader, moving, whole = FieldReader(), woven(floor_at(0), floor_at(6)), floor_at(0)

    for _ in range(4):
        assert reader.read(moving.copy()).tobytes() != moving.tobytes()
        for _ in range(15):
            assert reader.read(whole.copy()).tobytes() == whole.tobytes()

    assert not reader.is_interlaced


def test_the_way_of_interlaced_video_is_that_of_one_of_its_fields(camera, ground, track):
    steps_px = np.repeat([3.0, 25.0, 6.0, 20.0], 12)
    way_m = camera.metres_per_pixel[0] * np.concatenate([[0.0], np.cumsum(steps_px / 2.0)])
    run = ground_run(
        lambda t: Pose2(float(way_m[min(round(70 * t), len(way_m) - 1)])), 48, ground=ground, camera=camera
    )
    frames = [
        frame.__class__(frame.sensor, frame.stamp_s, Image(woven(frame.payload.pixels, after.payload.pixels)))
        for frame, after in zip(run.frames[::2], run.frames[1::2])
    ]

    tracked = track(run, change=lambda index, frame: frames[index // 2] if index % 2 == 0 else None)

    assert len(tracked.motions) >= 20
    for motion in tracked.motions:
        at = [way_m[round(70 * stamp_s)] for stamp_s in (motion.since_s, motion.stamp_s)]
        assert math.isclose(motion.pose_since_now.x, at[1] - at[0], abs_tol=5e-4)
