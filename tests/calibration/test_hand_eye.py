"""The place of a sensor in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trailmark.errors import DataError, ShapeError
from trailmark.geometry import Pose2
from trailmark_calibration import solve_hand_eye, solve_hand_eye_and_scale

METRES = st.floats(-2.0, 2.0)
ANGLES = st.floats(-3.0, 3.0)
POSES = st.builds(Pose2, METRES, METRES, ANGLES)


def as_seen_from(mounting: Pose2, motions: list[Pose2]) -> np.ndarray:
    return np.array([(mounting.inverse() @ motion @ mounting).array() for motion in motions])


def test_a_quarter_turn_and_a_metre_ahead_by_hand():
    # A sensor 1 m ahead of base that looks to the left: a quarter turn of base carries it from (1, 0) to (0, 1).
    base = np.array([[0.0, 0.0, math.pi / 2], [1.0, 0.0, 0.0]])
    sensor = np.array([[1.0, 1.0, math.pi / 2], [0.0, -1.0, 0.0]])

    found = solve_hand_eye(base, sensor)

    np.testing.assert_allclose(found.array(), [1.0, 0.0, math.pi / 2], atol=1e-9)


@given(mounting=POSES, motions=st.lists(POSES, min_size=2, max_size=6), scale=st.floats(0.3, 3.0))
@settings(max_examples=60, deadline=None)
def test_any_place_is_found_from_any_motions_that_turn_and_drive(mounting, motions, scale):
    motions = [*motions, Pose2(1.0, 0.2, 0.0), Pose2(0.1, 0.0, 1.2), Pose2(0.3, -0.2, -0.8)]
    base = np.array([motion.array() for motion in motions])
    sensor = as_seen_from(mounting, motions)

    found = solve_hand_eye(base, sensor)
    scaled, factor = solve_hand_eye_and_scale(base / (scale, scale, 1.0), sensor)

    for one in (found, scaled):
        assert one.distance_to(mounting) < 1e-6
        assert abs(math.remainder(one.theta - mounting.theta, 2 * math.pi)) < 1e-6
    assert factor == pytest.approx(scale, rel=1e-6)


def test_weights_of_nothing_leave_wrong_motions_out():
    mounting, motions = Pose2(0.3, -0.1, 1.0), [Pose2(0.5, 0.0, 0.3), Pose2(0.0, 0.1, -0.9), Pose2(1.0, 0.0, 0.0)]
    base = np.array([motion.array() for motion in motions])
    sensor = as_seen_from(mounting, motions)
    base = np.concatenate([base, [[5.0, 5.0, 0.1]]])
    sensor = np.concatenate([sensor, [[-3.0, 0.0, 0.1]]])

    found = solve_hand_eye(base, sensor, weights=np.array([1.0, 1.0, 1.0, 0.0]))

    np.testing.assert_allclose(found.array(), mounting.array(), atol=1e-9)


def test_without_turns_the_place_is_refused():
    straight = np.array([[1.0, 0.0, 0.0], [0.5, 0.0, 0.0]])

    with pytest.raises(DataError, match="no turn"):
        solve_hand_eye(straight, straight)


def test_a_turn_in_place_alone_does_not_tell_the_scale():
    turns = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, -0.3]])

    with pytest.raises(DataError, match="do not determine"):
        solve_hand_eye_and_scale(turns, turns)


def test_motions_come_in_pairs():
    with pytest.raises(ShapeError, match="one length"):
        solve_hand_eye(np.zeros((3, 3)), np.zeros((2, 3)))
