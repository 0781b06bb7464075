"""The localizer over synthetic floors: accuracy, and knowing when it is lost."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from trailmark.errors import ConfigError, ShapeError
from trailmark.estimates import Belief, Motion
from trailmark.frames import Frame, GroundPlane, Image, Pinhole, Scalar
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import Session
from trailmark.testing.ground import GroundCamera, MirroredFloor, circle, ground_run, straight
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.localizer import GroundVO

SPEED_MPS = 0.26  # of the paper: 9.5 px per frame
LOST_AT = 12


@pytest.mark.parametrize(
    ("mode", "position_m", "heading_deg"),
    [("refined", 0.1e-3, 0.02), ("pyramid", 3e-3, 0.6), ("whole_pixels", 3e-3, 0.6)],
)
def test_a_drive_is_measured(mode, position_m, heading_deg, camera, ground, track):
    motion = straight(SPEED_MPS, sway_m=0.003, sway_s=1.0, shake_rad=0.0009)

    tracked = track(ground_run(motion, 70, ground=ground, camera=camera), mode=mode)

    x, y, theta = tracked.error()
    assert not tracked.lost
    assert len(tracked.motions) == 69
    assert math.hypot(x, y) < position_m
    assert abs(math.degrees(theta)) < heading_deg


def test_a_tight_and_fast_circle_is_measured(camera, ground, track):
    """1.5 deg and 11 px per frame."""
    run = ground_run(circle(0.3, 0.3 / (math.radians(1.5) * 70)), 60, ground=ground, camera=camera)

    tracked = track(run)

    x, y, theta = tracked.error()
    assert math.hypot(x, y) < 0.1e-3
    assert abs(math.degrees(theta)) < 0.03


@pytest.mark.parametrize("mode", ["refined", "whole_pixels"])
def test_a_robot_that_stands_is_not_told_to_move(mode, camera, ground, track):
    tracked = track(ground_run(lambda _: Pose2(0.1, 0.2, 0.3), 20, ground=ground, camera=camera), mode=mode)

    x, y, theta = tracked.error()
    assert math.hypot(x, y) < 5e-6
    assert abs(theta) < 1.5e-4


def test_mounting_and_two_scales_are_taken_into_account(ground, track):
    camera = GroundCamera((320, 288), (4.2e-4, 3.9e-4), mounting=Pose3(x=0.2, y=-0.1, yaw=0.6), noise_sigma=3.0)
    run = ground_run(circle(0.26, 0.4), 60, ground=ground, camera=camera)

    tracked = track(run)

    x, y, theta = tracked.error()
    assert math.hypot(x, y) < 0.15e-3
    assert abs(math.degrees(theta)) < 0.03


def test_vignette_and_lens_are_removed_by_the_calibration(ground, track):
    lens = Pinhole(500.0, 500.0, 159.5, 143.5, (-0.15, 0.0, 0.0, 0.0))
    camera = GroundCamera((320, 288), noise_sigma=2.0, vignette=0.35, lens=lens)
    run = ground_run(straight(SPEED_MPS), 60, ground=ground, camera=camera)

    calibrated = track(run)
    blind = track(replace(run, sensor=replace(run.sensor, calibration=GroundPlane(camera.metres_per_pixel))))

    assert abs(calibrated.error()[0]) < 0.15e-3
    assert abs(blind.error()[0]) > 10 * abs(calibrated.error()[0])


def test_the_first_motion_may_be_as_fast_as_the_paper_allows(camera, ground, track):
    """40 px per frame from the first frame on, with nothing known before it."""
    run = ground_run(straight(40 * 3.9e-4 * 70), 12, ground=ground, camera=camera)

    tracked = track(run)

    assert not tracked.lost
    assert abs(tracked.error()[0]) < 0.1e-3


def test_a_dropped_frame_does_not_lose_the_track(camera, ground, track):
    run = ground_run(straight(SPEED_MPS), 30, ground=ground, camera=camera)

    tracked = track(run, change=lambda index, frame: None if index in (10, 17, 18) else frame, wide_search=False)

    assert not tracked.lost
    assert math.hypot(*tracked.error()[:2]) < 0.1e-3
    assert tracked.motions[9].stamp_s - tracked.motions[9].since_s == pytest.approx(2 / 70)


def covered(frame, rng):
    other = MirroredFloor.procedural(seed=99, size_px=512, contrast=20.0)
    pose = Pose2(float(rng.uniform(0, 3)), 0.0, 0.0)
    return GroundCamera(frame.payload.size, noise_sigma=3.0).image(other, pose, seed=5)


def blurred(frame, rng):
    noise = 3.0 * rng.standard_normal(frame.payload.pixels.shape)
    streaks = cv2.blur(frame.payload.pixels.astype(np.float32), (61, 1)) + noise
    return np.clip(streaks, 0, 255).astype(np.uint8)


def blank(frame, rng):
    return np.clip(128 + 3.0 * rng.standard_normal(frame.payload.pixels.shape), 0, 255).astype(np.uint8)


def black(frame, rng):
    return np.zeros_like(frame.payload.pixels)


def spoilt(spoil, first, last):
    rng = np.random.default_rng(4)

    def change(index, frame):
        return Frame("floor", frame.stamp_s, Image(spoil(frame, rng))) if first <= index <= last else frame

    return change


@pytest.mark.parametrize("mode", ["refined", "pyramid", "whole_pixels"])
@pytest.mark.parametrize("spoil", [covered, blurred, blank, black])
def test_a_spoilt_picture_is_lost_and_bridged_by_the_next_motion(spoil, mode, camera, ground, track):
    run = ground_run(straight(SPEED_MPS), 20, ground=ground, camera=camera)

    tracked = track(run, change=spoilt(spoil, LOST_AT, LOST_AT), mode=mode)

    stamps = run.truth.stamps_s
    assert [lost.stamp_s for lost in tracked.lost] == [stamps[LOST_AT]]
    assert "match" in tracked.lost[0].reason
    assert len(tracked.motions) == 20 - 2
    bridge = tracked.motions[LOST_AT - 1]
    assert (bridge.since_s, bridge.stamp_s) == (stamps[LOST_AT - 1], stamps[LOST_AT + 1])
    assert tracked.error()[0] == pytest.approx(0.0, abs=0.4e-3)


@pytest.mark.parametrize("mode", ["refined", "whole_pixels"])
def test_a_long_loss_leaves_a_gap_and_then_the_track_is_found_again(mode, camera, ground, track):
    run = ground_run(straight(SPEED_MPS), 30, ground=ground, camera=camera)

    tracked = track(run, change=spoilt(blank, LOST_AT, LOST_AT + 8), mode=mode)

    stamps, resumed = run.truth.stamps_s, tracked.motions[LOST_AT - 1]
    assert 9 <= len(tracked.lost) <= 12
    assert resumed.since_s > stamps[LOST_AT + 8]
    assert resumed.pose_since_now.x == pytest.approx(SPEED_MPS / 70, abs=0.4e-3)
    assert all(lost.stamp_s < stamps[LOST_AT + 12] for lost in tracked.lost)


def test_a_motion_beyond_the_reach_of_the_paper_is_lost_in_its_mode(camera, ground, track):
    run = ground_run(straight(70 * 3.9e-4 * 70), 6, ground=ground, camera=camera)

    tracked = track(run, mode="whole_pixels")

    assert len(tracked.lost) == 5
    assert "too fast" in tracked.lost[0].reason


def test_a_motion_of_a_quarter_of_the_picture_is_followed(camera, ground, track):
    run = ground_run(straight(70 * 3.9e-4 * 70), 6, ground=ground, camera=camera)

    tracked = track(run)

    assert not tracked.lost
    assert math.hypot(*tracked.error()[:2]) < 0.2e-3


def test_without_the_wide_search_the_start_must_be_slow(camera, ground, track):
    run = ground_run(straight(20 * 3.9e-4 * 70), 4, ground=ground, camera=camera)

    assert len(track(run, wide_search=False).lost) == 3
    assert not track(run).lost


def test_the_refinement_never_leaves_a_larger_error_than_whole_pixels_over_a_way(camera, ground, track):
    run = ground_run(straight(SPEED_MPS, sway_m=0.003, sway_s=1.0), 70, ground=ground, camera=camera)

    refined, whole = track(run, mode="refined"), track(run, mode="whole_pixels")

    assert math.hypot(*refined.error()[:2]) < 0.2 * math.hypot(*whole.error()[:2])


def test_plain_kernels_give_the_same_answers(camera, ground, track):
    run = ground_run(straight(SPEED_MPS, shake_rad=0.001), 8, ground=ground, camera=camera)

    vectors, plain = track(run), track(run, use_vectors=False)

    assert vectors.pose == plain.pose


def test_information_tells_what_a_drive_drifts(camera, track):
    """Normalised squared errors of 1 over many drives; between a third and three is honest."""
    squares = []
    for seed in range(12):
        ground = MirroredFloor.procedural(seed=seed, size_px=512, grain_px=1.5)
        run = ground_run(straight(SPEED_MPS), 45, ground=ground, camera=camera, seed=seed)
        tracked = track(run, tilt_deg=0.0)  # as stiff as the camera of the drive
        covariance = sum(np.linalg.inv(motion.information) for motion in tracked.motions)
        error = tracked.error()
        squares.append([error[0] ** 2 / covariance[0, 0], error[2] ** 2 / covariance[2, 2]])

    along, heading = np.mean(squares, axis=0)
    assert 0.2 < along < 4.0
    assert 0.2 < heading < 4.0


def test_across_a_grain_the_information_knows_the_blind_direction(camera, track):
    lines = np.random.default_rng(0).normal(128.0, 25.0, 512)
    grain = cv2.GaussianBlur(np.tile(lines, (512, 1)).astype(np.float32), (0, 0), 1.5)
    run = ground_run(straight(SPEED_MPS), 5, ground=MirroredFloor(grain), camera=camera)

    motions = track(run).motions

    assert motions
    for motion in motions:  # from the first one on: noise along the grain has slopes, but holds nothing
        assert motion.information[0, 0] > 30 * motion.information[1, 1]


def test_details_are_plain_numbers(camera, ground, track):
    details = track(ground_run(straight(SPEED_MPS), 4, ground=ground, camera=camera)).motions[-1].details

    assert {"error", "error_ratio", "turn_spread_deg", "replaced", "residual", "iterations"} <= set(details)
    assert all(isinstance(value, float) and math.isfinite(value) for value in details.values())
    assert 0.0 < details["error_ratio"] < 0.8
    assert details["replaced"] == pytest.approx(9.5 / 192, rel=0.2)


def test_started_again_it_is_as_new(camera, ground):
    run = ground_run(straight(SPEED_MPS), 6, ground=ground, camera=camera)
    localizer = GroundVO(GroundVOConfig(camera="floor"))
    session = Session(sensors={"floor": run.sensor})

    answers = []
    for _ in range(2):
        localizer.start(session)
        said = [localizer.observe(frame, Belief(frame.stamp_s)) for frame in run.frames]
        answers.append([motion[0].pose_since_now for motion in said[1:]])
        assert said[0] == ()
        localizer.close()

    assert answers[0] == answers[1]


def test_frames_of_other_sensors_are_not_looked_at(camera, ground):
    run = ground_run(straight(SPEED_MPS), 2, ground=ground, camera=camera)
    localizer = GroundVO(GroundVOConfig(camera="floor"))
    localizer.start(Session(sensors={"floor": run.sensor}))

    assert localizer.observe(Frame("light", 0.0, Scalar(3.0)), Belief(0.0)) == ()


def test_lost_frames_are_counted(camera, ground):
    run = ground_run(straight(250 * 3.9e-4 * 70), 3, ground=ground, camera=camera)
    localizer = GroundVO(GroundVOConfig(camera="floor"))
    localizer.start(Session(sensors={"floor": run.sensor}))

    for frame in run.frames:
        localizer.observe(frame, Belief(frame.stamp_s))

    assert localizer.counters()["lost"] == 2


def test_a_picture_of_another_size_is_refused(camera, ground):
    run = ground_run(straight(SPEED_MPS), 1, ground=ground, camera=camera)
    localizer = GroundVO(GroundVOConfig(camera="floor"))
    localizer.start(Session(sensors={"floor": run.sensor}))
    localizer.observe(run.frames[0], Belief(0.0))

    with pytest.raises(ShapeError, match="changed from 320 x 288 uint8 to 200 x 200 uint8"):
        localizer.observe(Frame("floor", 1.0, Image(np.zeros((200, 200), np.uint8))), Belief(1.0))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"margin_px": 150}, r"pictures of 320 x 288 are too small for a rim of 150 px"),
        ({"margin_px": 40, "max_shift_px": 36}, r"margin_px is 40, but shifts of 36 \+ 8 px"),
        ({"margin_px": 40, "mode": "whole_pixels"}, r"margin_px is 40, but shifts of 36 \+ 8 px"),
        ({"centre_distance_px": 205}, r"viewpoints 205 px apart"),
    ],
)
def test_a_geometry_that_cannot_be_is_refused_at_the_start(keys, message, camera):
    localizer = GroundVO(GroundVOConfig(camera="floor", **keys))

    with pytest.raises(ConfigError, match=message):
        localizer.start(Session(sensors={"floor": camera.sensor_info("floor")}))


def test_motion_information_is_symmetric_and_positive(camera, ground, track):
    for motion in track(ground_run(circle(0.3, 0.4), 6, ground=ground, camera=camera)).motions:
        assert isinstance(motion, Motion)
        np.testing.assert_array_equal(motion.information, motion.information.T)
        assert np.all(np.linalg.eigvalsh(motion.information) > 0)
