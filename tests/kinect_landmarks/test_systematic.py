"""What does not average out grows with the way, and is told."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.geometry import Pose2, Pose3
from trailmark_kinect_landmarks.expectation import Expectation
from trailmark_kinect_landmarks.systematic import (
    Rates,
    TravelledWay,
    depth_share,
    motion_systematic,
    systematic_covariance,
)


def test_a_share_of_the_way_is_unsure() -> None:
    covariance = systematic_covariance(0.01, TravelledWay(way_m=3.0), None)

    assert math.sqrt(covariance[0, 0]) == pytest.approx(0.03)
    assert covariance[2, 2] == 0.0


def test_it_grows_with_the_way_and_not_with_its_root() -> None:
    near, far = (systematic_covariance(0.01, TravelledWay(way_m, 0.4, 2.0), None) for way_m in (1.0, 4.0))
    of_turn = systematic_covariance(0.01, TravelledWay(0.0, 0.4, 2.0), None)

    ways = [math.sqrt(c[0, 0]) - math.sqrt(of_turn[0, 0]) for c in (near, far)]
    assert ways[1] == pytest.approx(4.0 * ways[0])


def test_depth_that_was_confirmed_is_surer_than_depth_that_was_not() -> None:
    assert depth_share("as given") < depth_share("measured") < depth_share("unknown")


def test_stamps_that_are_off_matter_in_the_direction_of_motion() -> None:
    rates = Rates(np.array([1.0, 0.0]), 0.0, 0.0)

    covariance = systematic_covariance(0.0, TravelledWay(), rates)

    assert covariance[0, 0] > 0.0
    assert covariance[1, 1] == covariance[2, 2] == 0.0


@pytest.mark.parametrize("n", [10, 50])
def test_motions_of_a_metre_add_up_to_what_the_metre_is_unsure(n: int) -> None:
    step = Pose2(1.0 / n)

    one = motion_systematic(0.01, step, 0.1, 2.0)

    of_all = math.sqrt(n * one[0, 0])  # what an estimator makes of n independent motions
    assert of_all == pytest.approx(0.01 * 1.0)


def test_the_expectation_knows_how_fast_it_turns() -> None:
    expectation = Expectation()
    expectation.begin(0.0, np.eye(4))
    assert expectation.rates() is None

    expectation.took(0.1, Pose3(x=0.03, yaw=0.02).matrix())

    rates = expectation.rates()
    assert rates is not None
    np.testing.assert_allclose(rates.velocity_mps, (0.3, 0.0), atol=1e-12)
    assert rates.turn_radps == pytest.approx(0.2)
    assert rates.spin_radps == pytest.approx(0.2)
