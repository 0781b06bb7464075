"""Constant speed as a localizer."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from trailmark.estimates import Belief
from trailmark.frames import Frame, Image, Scalar
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark_baselines.config import ConstantSpeedConfig
from trailmark_baselines.constant_speed import ConstantSpeed


def localizer(**keys) -> ConstantSpeed:
    made = ConstantSpeed(ConstantSpeedConfig.model_validate({"clock": "front", **keys}))
    made.start(Session())
    return made


def observed(made: ConstantSpeed, *stamps_s: float) -> list:
    frames = [Frame("front", stamp_s, Scalar(0.0)) for stamp_s in stamps_s]
    return [estimate for frame in frames for estimate in made.observe(frame, Belief(frame.stamp_s))]


def test_the_way_is_speed_times_time_whatever_the_intervals():
    motions = observed(localizer(speed_mps=0.3), 10.0, 10.1, 10.15, 10.9)

    assert [(motion.since_s, motion.stamp_s) for motion in motions] == [(10.0, 10.1), (10.1, 10.15), (10.15, 10.9)]
    assert sum(motion.pose_since_now.x for motion in motions) == pytest.approx(0.27)
    assert all(motion.pose_since_now.y == 0.0 for motion in motions)


def test_a_turning_robot_drives_an_arc():
    (motion,) = observed(localizer(speed_mps=math.pi / 2, turn_deg_per_s=90, max_gap_s=2), 0.0, 1.0)

    np.testing.assert_allclose(motion.pose_since_now.array(), Pose2(1.0, 1.0, math.pi / 2).array(), atol=1e-12)


def test_negative_speed_drives_backwards():
    (motion,) = observed(localizer(speed_mps=-0.5), 0.0, 1.0)

    assert motion.pose_since_now == Pose2(-0.5)


def test_a_gap_is_left_and_counted():
    made = localizer(speed_mps=1.0, max_gap_s=0.5)

    motions = observed(made, 0.0, 0.25, 5.0, 5.25)

    assert [(motion.since_s, motion.stamp_s) for motion in motions] == [(0.0, 0.25), (5.0, 5.25)]
    assert made.counters() == {"gaps": 1}


def test_the_spread_is_wide_and_grows_with_the_root_of_the_time():
    keys = {"speed_mps": 0.3, "distance_sigma": 0.2, "lateral_sigma": 0.1, "turn_sigma_deg": 10.0}

    (motion,) = observed(localizer(**keys), 0.0, 0.25)

    covariance = np.linalg.inv(motion.information)
    assert math.sqrt(covariance[0, 0]) == pytest.approx(0.1)
    assert math.sqrt(covariance[2, 2]) == pytest.approx(math.radians(5.0))
    assert math.sqrt(covariance[1, 1]) >= 0.05


def test_any_payload_is_a_clock():
    made = localizer(speed_mps=1.0)
    picture = Image(np.zeros((2, 2), np.uint8))

    made.observe(Frame("front", 0.0, picture), Belief(0.0))

    assert len(made.observe(Frame("front", 0.5, picture), Belief(0.5))) == 1


def test_started_again_it_has_forgotten_the_last_frame():
    made = localizer(speed_mps=1.0)
    observed(made, 0.0, 5.0)

    made.start(Session())

    assert observed(made, 5.5) == []
    assert made.counters() == {"gaps": 0}


def test_a_robot_that_stands_needs_no_localizer():
    with pytest.raises(ValidationError, match="must not be 0: a robot that stands needs no localizer"):
        localizer(speed_mps=0)
