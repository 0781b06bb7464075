"""Real floors: photographs that the paper's camera drives over, with a vignette and its flat field."""

from __future__ import annotations

import math

import cv2
import pytest

from trailmark.geometry import Pose2
from trailmark.testing.ground import GroundCamera, MirroredFloor, ground_run, straight

FLOORS = [
    "artificial_turf_1k",
    "asphalt",
    "asphalt_cracked_1k",
    "grass_1k",
    "pavers",
    "planks",
    "tiles_1k",
    "warehouse_concrete_1k",
    "wood_dark",
    "wood_floor",
]
LOW_CONTRAST = {"wood_dark": 4.0}


def drive(folder, floor, n_frames, seed):
    ground = MirroredFloor(cv2.imread(str(folder / f"{floor}.jpg"), cv2.IMREAD_GRAYSCALE))
    camera = GroundCamera(noise_sigma=3.0, vignette=0.3)
    motion = straight(0.26, sway_m=0.003, shake_rad=math.radians(0.05))
    start = Pose2(0.7 * seed, 0.3, 0.4 * seed)
    return ground_run(lambda time_s: start @ motion(time_s), n_frames, ground=ground, camera=camera, seed=seed)


@pytest.mark.data
@pytest.mark.parametrize("floor", FLOORS)
def test_on_every_floor_the_refined_mode_holds_the_track(floor, floors, track):
    tracked = track(drive(floors, floor, 90, seed=21), n_pixels=768)

    x, y, theta = tracked.error()
    tolerance = LOW_CONTRAST.get(floor, 1.0)
    assert not tracked.lost
    assert math.hypot(x, y) < tolerance * 0.15e-3  # of 0.33 m
    assert abs(math.degrees(theta)) < tolerance * 0.02


@pytest.mark.data
@pytest.mark.parametrize("floor", ["wood_floor", "artificial_turf_1k"])
@pytest.mark.parametrize("mode", ["pyramid", "whole_pixels"])
def test_whole_pixels_hold_the_track_too(floor, mode, floors, track):
    tracked = track(drive(floors, floor, 60, seed=22), n_pixels=768, mode=mode)

    x, y, theta = tracked.error()
    assert not tracked.lost
    assert math.hypot(x, y) < 3e-3  # of 0.22 m
    assert abs(math.degrees(theta)) < 1.0


@pytest.mark.data
@pytest.mark.long
@pytest.mark.parametrize("floor", FLOORS)
def test_ten_metres_straight_stay_within_the_bars(floor, floors, track):
    tracked = track(drive(floors, floor, 2700, seed=23), n_pixels=768)

    x, y, theta = tracked.error()
    way_m = 0.26 / 70 * 2699
    assert not tracked.lost
    assert math.hypot(x, y) / way_m < (3e-3 if floor == "wood_dark" else 1.5e-3)
    assert abs(math.degrees(theta)) / way_m < 0.03
