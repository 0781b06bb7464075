from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Belief
from trailmark.geometry import Pose2, Twist2
from trailmark_divs.config import DivsConfig
from trailmark_divs.eye import TURNING, ImagePreprocessor
from trailmark_divs.layout import make_layout

SIZE = (200, 20)
SCENE = np.random.default_rng(7).integers(0, 256, (10, 1200)).astype(np.uint8)


def make_eye(**settings):
    config = DivsConfig(camera="front", window=5, **settings)
    return ImagePreprocessor(config, make_layout(SIZE, 50, (0.0, 0.5)), math.radians(1.0))


def see(eye, headings_deg, has_odometry=True, first=0):
    """Show pictures that move as the robot turns, 4 px to a degree."""
    looks = []
    for k, heading_deg in enumerate(headings_deg, start=first):
        start = 600 - round(4 * heading_deg) % 600
        pose = Pose2(0.0, 0.0, math.radians(heading_deg)) if has_odometry else Pose2()
        belief = Belief(0.1 * k, pose_odom_base=pose, travelled_m=0.02 * k, twist=Twist2(0.2))
        looks.append(eye.look(np.ascontiguousarray(SCENE[:, start : start + 200]), 0.1 * k, belief))
    return looks


def test_the_first_picture_is_no_look_yet():
    assert see(make_eye(), [0.0]) == [None]


def test_looks_tell_when_and_where_both_pictures_were_taken():
    look = see(make_eye(), [0.0, 0.0, 0.0])[-1]

    assert look.ordinal == 1
    assert look.stamps_s == pytest.approx((0.1, 0.2))
    assert look.travelled_m == pytest.approx((0.02, 0.04))


def test_a_window_speaks_of_its_middle():
    eye = make_eye()
    see(eye, [0.1 * k for k in range(6)])

    window = eye.window()

    assert window.stamp_s == pytest.approx(0.25)
    assert window.travelled_m == pytest.approx(0.05)
    assert math.degrees(window.heading_rad) == pytest.approx(0.25)


@pytest.mark.parametrize("has_odometry", [True, False])
def test_a_turn_is_noticed_in_the_belief_or_in_the_pictures(has_odometry):
    looks = see(make_eye(), [0.0] * 8 + [5.0 * k for k in range(1, 6)], has_odometry)

    assert [look.run for look in looks[1:8]] == [0] * 7
    assert looks[-1].run == TURNING


def test_told_to_look_at_the_belief_it_does_not_see_turns_in_pictures():
    looks = see(make_eye(turn_source="belief"), [0.0] * 8 + [5.0 * k for k in range(1, 6)], has_odometry=False)

    assert looks[-1].run == 0


def test_after_a_turn_there_is_no_window_until_a_new_one_is_full():
    eye = make_eye()
    see(eye, [0.0] * 8)
    assert eye.window() is not None

    see(eye, [8.0], first=8)
    full = []
    for k in range(9, 20):
        look = see(eye, [8.0], first=k)[0]
        full.append((look.run, eye.window() is not None))

    # The turn is averaged over three pictures; then "time zero", and five differences.
    assert full == [(TURNING, False)] * 2 + [(1, False)] * 4 + [(1, True)] * 5
    assert eye.window().heading_rad == pytest.approx(math.radians(8.0))


def test_heading_is_not_wrapped():
    looks = see(make_eye(turn_limit_deg=500.0), [40.0 * k for k in range(12)])

    assert math.degrees(looks[-1].heading_rad) == pytest.approx(440.0)
