from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark_divs.turning import TurnGate, turned_columns

USABLE = np.ones(50, dtype=bool)


def states(gate, steps_deg):
    return [gate.push(math.radians(step)) for step in steps_deg]


def test_a_straight_drive_is_no_turn():
    assert not any(states(TurnGate(math.radians(6), 25), [0.1, -0.1] * 50))


def test_a_turn_begins_when_a_window_of_it_would_exceed_the_limit():
    gate = TurnGate(math.radians(6), 25)

    assert not any(states(gate, [0.2] * 50))
    assert any(states(gate, [0.3] * 10))


def test_a_turn_ends_at_half_of_the_rate_at_which_it_begins():
    gate = TurnGate(math.radians(6), 25)
    states(gate, [1.0] * 10)

    assert all(states(gate, [0.15] * 50))
    assert not all(states(gate, [0.1] * 10))


def test_turns_to_both_sides_count():
    assert any(states(TurnGate(math.radians(6), 25), [-1.0] * 5))


def test_a_step_turn_is_noticed_at_once_and_over_after_a_fifth_of_a_window():
    gate = TurnGate(math.radians(6), 25)
    states(gate, [0.0] * 10)

    assert states(gate, [5.0, 0, 0, 0, 0, 0]) == [True] * 5 + [False]


@pytest.mark.parametrize("columns", [-3.0, -0.4, 0.0, 0.6, 5.0])
def test_a_picture_that_moved_right_is_a_turn_to_the_left(columns):
    scene = np.convolve(np.random.default_rng(7).uniform(0, 255, 900), np.hanning(30), "same")
    before, now = (np.interp(10 * np.arange(50) + start, np.arange(900), scene) for start in (200, 200 - 10 * columns))

    assert turned_columns(before, now, USABLE, 5, 6) == pytest.approx(columns, abs=0.2)


def test_blank_pictures_do_not_turn():
    assert turned_columns(np.zeros(50), np.zeros(50), USABLE, 5, 6) == 0.0
