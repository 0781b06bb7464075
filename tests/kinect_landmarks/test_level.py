"""A camera that tilts is noticed by the heights of landmarks; noise, drift and a thing that is lifted are not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.geometry import Pose3
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


def test_two_tilted_pictures_in_a_row_end_the_plane() -> None:
    watch = LevelWatch(is_level=True)

    told = [watch.notices_tilt(*_seen(pitch_deg=pitch_deg)) for pitch_deg in (0.0, 3.0, 0.0, 3.0, 3.0, 0.0)]

    assert told == [False, False, False, False, True, False]
    assert watch.n_dimensions == 3


def test_few_landmarks_tell_of_no_tilt() -> None:
    points, heights_m = _seen(pitch_deg=10.0)
    watch = LevelWatch(is_level=True)

    assert not any(watch.notices_tilt(points[:5], heights_m[:5]) for _ in range(5))
    assert watch.n_dimensions == 2
