"""The synthetic floor and its camera."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from trailmark.errors import ShapeError
from trailmark.frames import GroundPlane, Pinhole
from trailmark.geometry import Pose2, Pose3
from trailmark.testing.ground import GroundCamera, MirroredFloor, circle, ground_run, straight

CAMERA = GroundCamera(size=(256, 240))
GROUND = MirroredFloor.procedural(seed=5, size_px=512, grain_px=3.0)


def warped(view, camera, pose_prev_now):
    """Bring the earlier view to where the camera is now, by the motion of base alone."""
    motion = camera.mounting.planar().inverse() @ pose_prev_now @ camera.mounting.planar()
    (mu, mv), (width, height) = camera.metres_per_pixel, camera.size
    u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    points_now = np.stack([(u - (width - 1) / 2) * mu, -(v - (height - 1) / 2) * mv], axis=-1)
    points_prev = (motion @ points_now.reshape(-1, 2)).reshape(points_now.shape)
    map_u = (points_prev[..., 0] / mu + (width - 1) / 2).astype(np.float32)
    map_v = (-points_prev[..., 1] / mv + (height - 1) / 2).astype(np.float32)
    return cv2.remap(view, map_u, map_v, cv2.INTER_LANCZOS4)


@pytest.mark.parametrize(
    "camera",
    [CAMERA, replace(CAMERA, mounting=Pose3(x=0.05, y=-0.02, yaw=0.7), metres_per_pixel=(3.906e-4, 3.917e-4))],
    ids=["as in the paper", "lever arm and two scales"],
)
def test_frames_warp_onto_each_other_by_the_closed_form_motion(camera):
    before, after = Pose2(31.3, -12.4, 0.4), Pose2(31.3021, -12.4013, 0.43)

    first, second = camera.view(GROUND, before), camera.view(GROUND, after)

    error = (warped(first, camera, before.between(after)) - second)[20:-20, 20:-20]
    assert np.sqrt(np.mean(error**2)) < 0.3
    assert np.sqrt(np.mean((first - second)[20:-20, 20:-20] ** 2)) > 3.0


def test_a_level_camera_over_the_origin_shows_the_texture_as_it_is():
    ground = MirroredFloor(np.arange(64 * 64, dtype=np.float32).reshape(64, 64) % 251, 1e-3)
    camera = GroundCamera((8, 6), (1e-3, 1e-3), mounting=Pose3(), supersample=1)

    view = camera.view(ground, Pose2(10.5e-3, -20.5e-3, 0.0))

    np.testing.assert_allclose(view, ground.texture[18:24, 7:15], atol=1e-3)


def test_a_half_turn_of_the_mounting_turns_the_picture_by_180_degrees():
    upright = replace(CAMERA, mounting=Pose3()).view(GROUND, Pose2(1.0, 2.0, 0.0))

    turned = CAMERA.view(GROUND, Pose2(1.0, 2.0, 0.0))

    np.testing.assert_allclose(turned, upright[::-1, ::-1], atol=2e-2)


def test_driving_forward_with_the_papers_mounting_moves_the_picture_to_the_right():
    first, second = (CAMERA.view(GROUND, Pose2(x, 0.0, 0.0)) for x in (0.0, 10 * 3.9e-4))

    np.testing.assert_allclose(second[:, 10:], first[:, :-10], atol=2e-2)


def test_the_floor_has_no_end_and_mirrors_at_its_edges():
    ground = MirroredFloor(np.arange(12, dtype=np.uint8).reshape(3, 4))

    window = ground.window(-1, 2, 3, 4)

    np.testing.assert_array_equal(window, [[2, 3, 3, 2], [2, 3, 3, 2], [6, 7, 7, 6]])


def test_noise_depends_on_seed_and_index_and_on_nothing_else():
    camera = replace(CAMERA, noise_sigma=3.0)
    pose = Pose2()

    image = camera.image(GROUND, pose, seed=1, index=4)

    np.testing.assert_array_equal(image, camera.image(GROUND, pose, seed=1, index=4))
    assert np.any(image != camera.image(GROUND, pose, seed=1, index=5))
    assert np.any(image != camera.image(GROUND, pose, seed=2, index=4))
    noise = image.astype(float) - camera.view(GROUND, pose)
    assert noise.std() == pytest.approx(math.hypot(3.0, 0.29), rel=0.02)


def test_gain_offset_and_vignette_act_on_the_light_before_rounding():
    dim = replace(CAMERA, gain=0.9, offset=5.0, vignette=0.2)

    view = dim.view(GROUND, Pose2())

    np.testing.assert_allclose(view, 0.9 * CAMERA.view(GROUND, Pose2()) * dim.flat_field + 5.0, rtol=1e-5)
    assert dim.flat_field[0, 0] == pytest.approx(0.8)
    flat = dim.sensor_info().calibration.flat_field
    np.testing.assert_allclose(flat * dim.flat_field.mean(), dim.flat_field, rtol=1e-5)


def test_a_lens_without_distortion_changes_nothing():
    lens = Pinhole(400.0, 400.0, 127.5, 119.5, (0.0, 0.0, 0.0, 0.0))

    view = replace(CAMERA, lens=lens).view(GROUND, Pose2(0.3, 0.1, 0.5))

    np.testing.assert_allclose(view, CAMERA.view(GROUND, Pose2(0.3, 0.1, 0.5)), atol=2e-2)


def test_a_distorted_picture_undistorts_to_the_ideal_one():
    lens = Pinhole(400.0, 400.0, 127.5, 119.5, (-0.3, 0.05, 0.001, -0.001))
    pose = Pose2(0.3, 0.1, 0.5)

    distorted = replace(CAMERA, lens=lens).view(GROUND, pose)

    restored = cv2.undistort(distorted, lens.matrix(), np.array(lens.distortion))
    error = (restored - CAMERA.view(GROUND, pose))[20:-20, 20:-20]
    assert np.sqrt(np.mean(error**2)) < 0.6  # bilinear undistortion
    assert np.sqrt(np.mean((distorted - CAMERA.view(GROUND, pose))[20:-20, 20:-20] ** 2)) > 3.0


def test_a_run_gives_frames_truth_and_calibration_that_fit():
    run = ground_run(straight(0.26, sway_m=0.002, shake_rad=0.001), 70, ground=GROUND, camera=CAMERA)

    frames = list(run.frames)

    assert len(frames) == len(run.truth) == 70
    assert [frame.stamp_s for frame in frames] == run.truth.stamps_s.tolist()
    assert frames[3].payload.size == (256, 240)
    assert run.truth.poses[-1, 0] == pytest.approx(0.26 * 69 / 70)
    assert isinstance(run.sensor.calibration, GroundPlane)
    assert run.sensor.rate_hz == 70.0
    np.testing.assert_array_equal(run.frames[-1].payload.pixels, frames[-1].payload.pixels)
    assert len(run.frames[10:13]) == 3


def test_the_same_drive_can_be_repeated_over_another_floor():
    run = ground_run(circle(0.26, 0.75), 3, ground=GROUND, camera=CAMERA)

    other = run.over(MirroredFloor.procedural(seed=6, size_px=512))

    assert other.truth is run.truth
    assert np.any(other.frames[1].payload.pixels != run.frames[1].payload.pixels)


def test_a_circle_comes_back_to_its_start():
    pose = circle(0.25, 0.75)(2 * math.pi * 0.75 / 0.25)

    assert pose.distance_to(Pose2()) < 1e-9
    assert circle(0.25, 0.75)(1.0).theta == pytest.approx(1 / 3)


def test_a_texture_of_another_kind_is_refused():
    with pytest.raises(ShapeError, match=r"uint8 or float32, not \(4, 4, 3\) uint8"):
        MirroredFloor(np.zeros((4, 4, 3), np.uint8))
