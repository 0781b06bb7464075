from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.frames import GroundPlane, Pinhole
from trailmark_divs.drift import DriftLaw, GainLearner, radians_per_column

PAPER = DriftLaw(None, 6.0)
SHIFTS = st.floats(-50, 50)


@pytest.mark.parametrize(
    ("shift", "heading_deg", "lateral_m"),
    [
        (0.0, 0.0, 0.0),
        (1.0, 1.0, 0.01),
        (-7.5, -7.5, -0.075),
        (10.0, 10.0, 0.1),
        (30.0, 10.0, 0.3),
        (-80.0, -10.0, -0.5),
    ],
)
def test_the_papers_gain_gives_equations_15_and_16(shift, heading_deg, lateral_m):
    heading_rad, lateral = PAPER.drift(shift)

    assert math.degrees(heading_rad) == pytest.approx(heading_deg)
    assert lateral == pytest.approx(lateral_m)


@given(SHIFTS, st.floats(10, 200), st.floats(0.5, 50))
def test_heading_and_offset_together_explain_the_shift(shift, columns_per_rad, depth_m):
    heading_rad, lateral_m = DriftLaw(columns_per_rad, depth_m).drift(shift)

    explained = columns_per_rad * (heading_rad + lateral_m / depth_m)
    if abs(math.degrees(heading_rad)) < 9.99 and abs(lateral_m) < 0.499:
        assert explained == pytest.approx(shift, abs=1e-9)
    else:
        assert abs(explained) <= abs(shift) + 1e-9


@given(SHIFTS, st.floats(10, 200))
def test_drift_is_odd(shift, columns_per_rad):
    law = DriftLaw(columns_per_rad, 6.0)

    np.testing.assert_allclose(law.drift(-shift), -np.array(law.drift(shift)))


@given(SHIFTS, st.floats(0.1, 5), st.floats(-3, 3))
def test_information_has_rank_one_and_its_one_sigma(shift, sigma, bend):
    law = DriftLaw(57.3, 6.0)

    information = law.information(shift, sigma, bend)

    assert np.linalg.matrix_rank(information, tol=1e-9 * np.abs(information).max()) == 1
    turn = np.array([0.0, 0.0, sigma / 57.3])  # a turn that shifts by one sigma
    assert turn @ information @ turn <= 1.0 + 1e-9
    if abs(shift) <= 8:
        assert turn @ information @ turn == pytest.approx(1.0)


def test_a_turn_back_and_an_offset_that_cancel_in_the_picture_are_not_told_apart():
    unseen = np.array([0.0, 6.0, -1.0])

    np.testing.assert_allclose(DriftLaw(57.3, 6.0).information(3.0, 0.5) @ unseen, 0.0, atol=1e-9)


def test_in_a_bend_the_shift_says_something_of_the_station_too():
    law = DriftLaw(57.3, 6.0)

    assert law.information(0.0, 0.5, 1.0)[0, 0] > 0
    assert law.information(0.0, 0.5, 0.1)[0, 0] == 0  # too gentle to be of use


def test_a_camera_that_looks_back_sees_the_offset_on_the_other_side():
    heading_rad, lateral_m = DriftLaw(57.3, -6.0).drift(4.0)

    assert heading_rad > 0 > lateral_m
    assert DriftLaw(57.3, -6.0).information(4.0, 0.5)[1, 2] < 0


def test_what_the_limits_cut_off_is_uncertain():
    law = DriftLaw(57.3, 6.0)

    assert law.information(45.0, 0.5)[2, 2] < 0.01 * law.information(5.0, 0.5)[2, 2]


def test_the_angle_of_a_column_comes_from_the_best_that_is_known():
    pinhole = Pinhole(600.0, 600.0, 319.5, 239.5)

    assert radians_per_column(pinhole, None, 12, 50, 640) == pytest.approx(12 / 600)
    assert radians_per_column(pinhole, 90.0, 12, 50, 640) == pytest.approx(12 / 320)
    assert math.degrees(radians_per_column(None, None, 12, 50, 640)) == pytest.approx(1.0)
    assert math.degrees(radians_per_column(GroundPlane((1e-3, 1e-3)), None, 6, 100, 640)) == pytest.approx(0.5)


@pytest.mark.parametrize("true_gain", [25.0, 57.3, 110.0])
def test_the_gain_is_learned_from_what_turns_do_to_the_shift(true_gain):
    rng = np.random.default_rng(7)
    learner = GainLearner(57.3, 0.5)

    for k in range(60):
        heading_rad = math.radians(4.0) * math.sin(k)
        learner.update(2.0 + true_gain * heading_rad + rng.normal(0, 0.3), 0.7 + heading_rad, 0.2 * k)

    assert learner.columns_per_rad == pytest.approx(true_gain, rel=0.05)


def test_standing_or_driving_straight_teaches_nothing():
    learner = GainLearner(57.3, 0.5)

    for k in range(100):
        learner.update(math.sin(k), 0.0, 0.2 * k)

    assert learner.columns_per_rad == 57.3


def test_a_turn_on_a_long_way_teaches_nothing():
    learner = GainLearner(57.3, 0.5)

    learner.update(0.0, 0.0, 0.0)
    learner.update(30.0, 0.1, 5.0)

    assert learner.columns_per_rad == 57.3


def test_the_learned_gain_stays_within_reason():
    learner = GainLearner(57.3, 0.5)

    for k in range(50):
        learner.update(20.0 * (-1) ** k, 0.03 * (-1) ** k, 0.1 * k)

    assert learner.columns_per_rad == pytest.approx(4 * 57.3)
