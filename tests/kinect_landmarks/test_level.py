"""A camera that tilts is noticed by the heights of landmarks; noise, drift and a thing that is lifted are not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.geometry import Pose3
from trailmark_kinect_landmarks.config import KinectLandmarksConfig
from trailmark_kinect_landmarks.level import LevelWatch, tilt_rad


def _seen(roll_deg: float = 0.0, pitch_deg: float = 0.0, noise_m: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """Return landmarks as a tilted camera sees them, and their true heights."""
    rng = np.random.default_rng(4)
    level = rng.uniform((1.0, -1.0, -0.5), (4.0, 1.0, 1.0), (22, 3))
    tilt = Pose3(roll=math.radians(roll_deg), pitch=math.radians(pitch_deg)).rotation()
    return level @ tilt + rng.normal(0.0, noise_m, (22, 3)), level[:, 2]


@pytest.mark.parametrize(("roll_deg", "pitch_deg"), [(0.0, 0.0), (0.0, 3.0), (-4.0, 0.0), (3.0, -4.0), (8.0, 9.0)])
def test_heights_tell_the_tilt(roll_deg: float, pitch_deg: float) -> None:
    told = math.degrees(tilt_rad(*_seen(roll_deg, pitch_deg)))

    assert told == pytest.approx(math.hypot(roll_deg, pitch_deg), rel=0.15, abs=0.3)


def test_a_thing_that_is_lifted_tilts_nothing() -> None:
    points, heights_m = _seen()
    points[:8, 2] += 0.4

    assert math.degrees(tilt_rad(points, heights_m)) < 0.5


@pytest.mark.parametrize("raised_m", [-0.04, 0.03])
def test_a_base_that_stands_higher_than_when_it_was_taught_tilts_nothing(raised_m: float) -> None:
    points, heights_m = _seen()
    points[:, 2] -= raised_m

    assert math.degrees(tilt_rad(points, heights_m)) < 0.5


@pytest.mark.parametrize(("rate_hz", "lasts_s", "ends"), [(30.0, 0.15, False), (30.0, 0.25, True), (2.0, 0.9, True)])
def test_a_tilt_that_lasts_ends_the_plane_and_a_nod_does_not(rate_hz: float, lasts_s: float, ends: bool) -> None:
    watch = LevelWatch(is_level=True)

    told = 0
    for stamp_s in np.arange(0.0, 3.0, 1.0 / rate_hz):
        told += watch.notices_tilt(stamp_s, *_seen(pitch_deg=3.0 if 1.0 <= stamp_s <= 1.0 + lasts_s else 0.0))

    assert told == ends
    assert watch.n_dimensions == (3 if ends else 2)


def test_one_tilted_picture_however_long_it_stands_is_a_nod() -> None:
    watch = LevelWatch(is_level=True)

    assert not any(watch.notices_tilt(s, *_seen(pitch_deg=3.0 if s == 1.0 else 0.0)) for s in (0.0, 1.0, 2.0))


def test_the_method_as_printed_stays_in_the_plane() -> None:
    config = KinectLandmarksConfig(camera="kinect", preset="paper")
    watch = LevelWatch(config.solve == "plane", notices=config.notice_tilt)

    assert not any(watch.notices_tilt(i / 10, *_seen(pitch_deg=5.0)) for i in range(20))
    assert watch.n_dimensions == 2


def test_few_landmarks_tell_of_no_tilt() -> None:
    points, heights_m = _seen(pitch_deg=10.0)
    watch = LevelWatch(is_level=True)

    assert not any(watch.notices_tilt(i / 10, points[:5], heights_m[:5]) for i in range(9))
    assert watch.n_dimensions == 2
